"""The command line: a verb, and ``key=value`` for everything else. No logic lives here."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tactileforge.errors import ConfigError, TactileForgeError

if TYPE_CHECKING:
    from omegaconf import DictConfig

USAGE = """\
tactileforge: train, compare and run encoders of touch

  tactileforge train [key=value ...]      train a recipe; --help shows every key
  tactileforge report RUN                 write the report of a run again
  tactileforge bench suite=NAME model=[NAME,...]    compare encoders; --help shows every key
  tactileforge sim out=DIR [key=value ...]  simulate touch and write it as shards; --help: keys
  tactileforge sim compare data=NAME      a page with simulated and real touches side by side
  tactileforge record sensor=[NAME,...] out=DIR   record sensors, forces and a camera as shards
  tactileforge calibrate data=NAME out=FILE.yaml  light, scale and force of one unit; --help: keys
  tactileforge live model=NAME sensor=NAME        touch as it happens: contact, force, slip, a page
  tactileforge data pack|filter|inspect|lerobot data=NAME   to shards; what a filter keeps; a page
                                          on it; to LeRobot's format
  tactileforge plugins list|check|new     what is installed, does it work, start your own
  tactileforge zoo list|show|get|pack     models by name; import your download, pack your run
  tactileforge export model=NAME format=onnx|torch_export   a model as a file that runs elsewhere
  tactileforge --version

  tactileforge train scale=demo                                   a small model on simulated touch
  tactileforge train recipe=anytouch2 data=recordings data.root=DIR
  tactileforge train resume=RUN                                   go on with a run that was stopped
"""


def main() -> None:
    """Entry point of ``tactileforge``; exits with 1 for an error and 130 when stopped."""
    sys.exit(run(sys.argv[1:]))


def run(argv: Sequence[str]) -> int:
    """Runs one command and gives its exit status."""
    verb, *rest = argv or ["--help"]
    try:
        if verb in ("-h", "--help", "help"):
            print(USAGE)
            return 0
        if verb == "--version":
            from tactileforge import __version__

            print(__version__)
            return 0
        if verb == "plugins":
            from tactileforge.plugins import main as plugins

            return plugins(rest)
        if verb == "data":
            from tactileforge.data_verbs import main as data

            return data(rest)
        if verb == "record":
            from tactileforge.record.verb import main as record

            return record(rest)
        if verb == "calibrate":
            from tactileforge.calibration.verb import main as calibrate

            return calibrate(rest)
        if verb == "live":
            from tactileforge.live.show_verb import main as live

            return live(rest)
        if verb == "zoo":
            from tactileforge.zoo_verbs import main as zoo

            return zoo(rest)
        if verb == "export":
            from tactileforge.export.verb import main as export

            return export(rest)
        if verb == "bench":
            from tactileforge.bench.verb import main as bench

            return bench(rest)
        if verb == "report":
            return _report(rest)
        if verb == "train":
            return _train(rest)
        if verb == "sim":
            return _sim(rest)
        raise ConfigError(f"unknown verb {verb!r}\n\n{USAGE}")
    except TactileForgeError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    except _hydra_error() as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt as stop:
        again = "tactileforge train resume=RUN" if verb == "train" else "the same command again"
        print(f"{stop or 'stopped'}; go on with: {again}", file=sys.stderr)
        return 130


def _hydra_error() -> type[Exception]:
    """What Hydra raises for a wrong override; evaluated only when something was raised."""
    from hydra.errors import HydraException

    return HydraException


def _sim(argv: Sequence[str]) -> int:
    from tactileforge import settings

    if argv[:1] == ["compare"]:
        from tactileforge.reality.verb import main as compare

        return compare(argv[1:])
    if argv in (["--help"], ["-h"]):
        print(settings.text("sim"))
        return 0
    config = settings.load("sim", argv)
    from tactileforge.sim.generate import SimConfig, write_seconds

    given = SimConfig(
        sensors=tuple(config.sensors),
        indenters=config.indenters if isinstance(config.indenters, str) else (*config.indenters,),
        motions=config.motions if isinstance(config.motions, str) else (*config.motions,),
        size=config.size,
        seconds=config.action_seconds,
        force=tuple(config.force),
        markers=config.markers,
        viscosity=config.viscosity,
        lag=config.lag,
        seed=config.seed,
        codec=config.codec,
        randomise=config.randomise if isinstance(config.randomise, str) else (*config.randomise,),
    )
    folder = Path(config.out)
    train, val = write_seconds(given, folder, config.seconds, config.val, config.processes)
    print(f"{train} touches for training and {val} for validation: {folder}")
    print(f"train on them: tactileforge train data=shards data.root={folder}")
    return 0


def _report(argv: Sequence[str]) -> int:
    if len(argv) != 1:
        raise ConfigError("give the folder of a run: tactileforge report RUN")
    from tactileforge.report.run import report_of_run

    print(f"report: {report_of_run(Path(argv[0]))}")
    return 0


def _train(argv: Sequence[str]) -> int:
    import hydra
    from hydra.core.hydra_config import HydraConfig

    from tactileforge.compose import finish, register

    register()
    os.environ.setdefault("HYDRA_FULL_ERROR", "1")  # its errors are raised, and printed by run()
    command = sys.argv

    ended: list[BaseException] = []  # Hydra would print an account of its own

    def task(config: DictConfig) -> None:
        sys.argv = command  # processes that Lightning starts for DDP repeat the whole command
        from tactileforge.train import train

        resume = config.get("resume")
        try:
            train(_resumed(resume) if resume else finish(config), Path(HydraConfig.get().run.dir))
        except (TactileForgeError, KeyboardInterrupt) as error:
            ended.append(error)

    sys.argv = ["tactileforge", *argv, *_resume_overrides(argv)]
    try:
        hydra.main(version_base="1.3", config_path="pkg://tactileforge.conf", config_name="train")(
            task
        )()
    finally:
        sys.argv = command
    if ended:
        raise ended[0]
    return 0


def _resume_overrides(argv: Sequence[str]) -> list[str]:
    """A resumed run stays in its folder; nothing else may be given with it."""
    folders = [word.partition("=")[2] for word in argv if word.startswith("resume=")]
    if not folders or folders[-1] in ("", "null"):
        return []
    given = [word for word in argv if not word.startswith(("resume=", "hydra.", "-"))]
    if given:
        raise ConfigError(
            f"resume= goes on with the same run, so {' '.join(given)} cannot be given with it; "
            "init= starts a new run from its weights"
        )
    return [f"hydra.run.dir={folders[-1]}", "hydra.output_subdir=null"]


def _resumed(folder: str) -> dict[str, Any]:
    from tactileforge.run_folder import read_config

    return {**read_config(Path(folder)), "resume": folder}
