"""GelSight Mini for tactileforge."""
