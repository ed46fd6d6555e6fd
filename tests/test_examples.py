"""Every example of a docstring runs, and public names have one."""

import doctest
import importlib
import inspect
from pathlib import Path
from types import ModuleType

import pytest

import tactileforge
from tactileforge import testing

ROOT = Path(__file__).parents[1]
#: Least share of the names of each public module with an example that runs.
LEAST = {"tactileforge": 0.5, "tactileforge.testing": 0.5}
FLAGS = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
#: Modules with examples, of this package and of those beside it that tests install.
MODULES = sorted(
    ".".join(path.relative_to(folder).with_suffix("").parts).removesuffix(".__init__")
    for folder in (ROOT / "src", *(ROOT / "plugins").glob("*/src"))
    for path in folder.rglob("*.py")
    if ">>> " in path.read_text("utf-8")
)


def _module(name: str) -> ModuleType:
    package = name.partition(".")[0]
    if importlib.util.find_spec(package) is None:
        pytest.skip(f"{package} is not installed")
    return importlib.import_module(name)


@pytest.mark.parametrize("name", MODULES)
def test_the_examples_of_a_module_run(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    result = doctest.testmod(_module(name), optionflags=FLAGS)
    assert result.failed == 0, "the output above has the differences"


def _has_example(name: str, module: ModuleType) -> bool:
    """Whether the docstring of a public name, or of its public methods, has a line to run."""
    found = getattr(module, name)
    if not (inspect.isclass(found) or inspect.isfunction(found) or inspect.ismodule(found)):
        return True  # a constant is its own example
    members = [found]
    if inspect.isclass(found):
        members += [member for key, member in vars(found).items() if not key.startswith("_")]
    texts = [inspect.getdoc(member) or "" for member in members]
    examples = [one for text in texts for one in doctest.DocTestParser().get_examples(text)]
    return any(not one.options.get(doctest.SKIP) for one in examples)


@pytest.mark.parametrize("module", [tactileforge, testing], ids=lambda m: m.__name__)
def test_public_names_have_an_example(module: ModuleType) -> None:
    names = [name for name in module.__all__ if not name.startswith("__")]
    without = [name for name in names if not _has_example(name, module)]
    share = 1 - len(without) / len(names)
    assert share >= LEAST[module.__name__], f"{share:.0%}; without: {without}"
