"""The gallery of the documentation: a picture and three lines for every built-in part."""
