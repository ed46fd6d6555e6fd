"""HTML pages: style, pieces, figures and images."""
