from tactileforge.cli import run


def test_the_suite_is_an_option_of_bench(capsys):
    assert run(["bench", "suite=forces_at_a_glance", "model=pixels", "--cfg", "job"]) == 0
    shown = capsys.readouterr().out
    assert "glance_force" in shown
    assert "target: force" in shown
