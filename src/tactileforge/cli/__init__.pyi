from collections.abc import Sequence

from tactileforge.cli._command import Command as Command
from tactileforge.cli._compose import option as option
from tactileforge.cli._quote import hydra_value as hydra_value
from tactileforge.cli._quote import unquoted as unquoted

def main() -> None: ...
def run(argv: Sequence[str]) -> int: ...
