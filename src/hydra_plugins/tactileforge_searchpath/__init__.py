"""Our groups, recipes and plugins in every application with Hydra, behind the application's own.

Hydra imports each module of the namespace ``hydra_plugins`` and registers the plugins it finds.
"""

from tactileforge.cli._sources import PluginSource, SearchPath

__all__ = ["PluginSource", "SearchPath"]
