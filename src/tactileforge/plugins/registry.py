"""Plugins by name.

Listing reads metadata only, imports nothing and never fails. Using a plugin fails loudly.

- `kinds`: kinds of plugins, and the groups of a configuration that name them
- `metadata`: names of plugins, installed and registered
- `loading`: classes by name
- `building`: plugins from a configuration
"""

from tactileforge.plugins.building import build as build
from tactileforge.plugins.building import check_hints as check_hints
from tactileforge.plugins.building import check_node as check_node
from tactileforge.plugins.building import check_types as check_types
from tactileforge.plugins.building import checked as checked
from tactileforge.plugins.building import chosen as chosen
from tactileforge.plugins.building import meanings as meanings
from tactileforge.plugins.building import options as options
from tactileforge.plugins.building import without_start as without_start
from tactileforge.plugins.class_contracts import context as context
from tactileforge.plugins.class_contracts import parameters as parameters
from tactileforge.plugins.kinds import GROUPS as GROUPS
from tactileforge.plugins.kinds import KINDS as KINDS
from tactileforge.plugins.kinds import MODULES as MODULES
from tactileforge.plugins.kinds import OTHERS as OTHERS
from tactileforge.plugins.loading import adopt as adopt
from tactileforge.plugins.loading import dotted as dotted
from tactileforge.plugins.loading import get as get
from tactileforge.plugins.loading import give as give
from tactileforge.plugins.loading import head_of as head_of
from tactileforge.plugins.loading import load as load
from tactileforge.plugins.loading import register as register
from tactileforge.plugins.metadata import PluginInfo as PluginInfo
from tactileforge.plugins.metadata import list_plugins as list_plugins
from tactileforge.plugins.metadata import names as names
