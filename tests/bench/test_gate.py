"""The release gate: intervals against closed forms, and what passes."""
