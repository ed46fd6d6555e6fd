"""DIGIT for tactileforge."""
