"""Every shipped plugin of every kind passes the command for its users."""

import pytest

from tactileforge.cli import dispatch
from tactileforge.plugins import registry
from tactileforge.plugins.distributions import is_ours

SHIPPED = sorted(
    (one.kind.removesuffix("s"), one.name)
    for one in registry.list_plugins()
    if one.kind in (*registry.KINDS, *registry.MODULES) and is_ours(one.distribution)
)
#: Options that make data and networks small enough for a test.
SMALL = {
    ("dataset", "sim"): ("scenes=3", "val=1", "size=32", "indenters=few", "sensors=[digit]"),
    ("dataset", "sim_array"): ("scenes=2", "val=1"),
    ("encoder", "plain_vit"): ("size=tiny", "depth=2"),
    ("encoder", "tactile_vit"): ("size=tiny", "depth=2"),
}


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "name"), SHIPPED, ids=["-".join(one) for one in SHIPPED])
def test_it_passes_its_check(kind, name, capsys):
    words = ["check", name, "--kind", kind, *SMALL.get((kind, name), ())]
    failed = dispatch("plugins", words)
    out = capsys.readouterr().out
    assert not failed, out
    assert ", 0 failed, " in out.splitlines()[-1]


def test_every_kind_is_among_them():
    kinds = {kind for kind, _ in SHIPPED}
    assert kinds == {kind.removesuffix("s") for kind in (*registry.KINDS, *registry.MODULES)}
