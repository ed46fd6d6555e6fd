from collections.abc import Sequence

from tactileforge.cli._quote import hydra_value as hydra_value
from tactileforge.cli._quote import unquoted as unquoted
from tactileforge.cli.command import Command as Command
from tactileforge.cli.compose import option as option

def main() -> None: ...
def run(argv: Sequence[str]) -> int: ...
