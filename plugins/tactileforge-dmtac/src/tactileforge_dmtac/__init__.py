"""DM-Tac for tactileforge."""
