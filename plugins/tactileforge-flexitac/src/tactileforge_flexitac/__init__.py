"""FlexiTac for tactileforge."""
