"""Checks of touch data: rules with a code, a reason and a fix, run wherever data enters."""
