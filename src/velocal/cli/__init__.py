"""The command line `velocal`: a module per subject, put together here."""

from __future__ import annotations

import sys
from typing import Annotated

import typer

from velocal.cli import calibration, init, plan, points, recordings, run
from velocal.cli.common import errors, escape
from velocal.errors import VelocalError
from velocal.io.output import stopped_cleanly

#: Exit codes of all commands, for users: docs/how-to.md shows them.
EXIT_CODES = {
    0: "the command did what it was asked for",
    1: "an input was refused, `calibration lint` found a fault, or a job of `run` failed",
    2: "there is no such command or option, or an argument is missing",
    129: "ended by SIGHUP: the terminal was closed",
    130: "ended by SIGINT: Ctrl-C",
    143: "ended by SIGTERM",
}

app = typer.Typer(
    help="Calibrate Velodyne laser scanners against surveyed planes.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
app.command()(recordings.inspect)
app.command()(recordings.decode)
calibration.app.command("from-recording")(recordings.from_recording)
calibration.app.command("from-cloud")(recordings.from_cloud)
app.add_typer(calibration.app, name="calibration")
app.command()(points.points)
app.command()(init.init)
app.command()(plan.plan)
app.command(context_settings={"allow_extra_args": True, "ignore_unknown_options": True})(run.run)


def main() -> None:
    """Run the command line.

    Faults of the input end in one message and exit code 1, wrong calls in one and exit code 2;
    `EXIT_CODES` lists all.
    """
    try:
        with stopped_cleanly():
            code = app(standalone_mode=False)
    except VelocalError as error:
        errors.print(f"[bold red]Error:[/] {escape(str(error), newlines=True)}")
        sys.exit(1)
    except typer.TyperException as error:
        # Without a message it is a call without arguments, and the help has been printed.
        if message := error.format_message():
            context = getattr(error, "ctx", None)
            called = context.command_path if context else "velocal"
            errors.print(f"[bold red]Error:[/] {escape(message, newlines=True)}")
            errors.print(f"Hint: `{called} --help` shows what is possible.")
        sys.exit(error.exit_code)
    except typer.Abort:
        sys.exit(130)
    sys.exit(code if isinstance(code, int) else 0)


def _show_version(wanted: bool) -> None:
    """Print the versions and end, if that is asked for."""
    if wanted:
        from velocal import __version__
        from velocal.io.commit import commit
        from velocal.io.provenance import versions

        print("\n".join([f"velocal {__version__}", f"commit {commit()}"]))
        for name, version in versions().items():
            if name != "velocal":
                print(f"{name} {version}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool,
        typer.Option("--version", callback=_show_version, is_eager=True, help="Show versions."),
    ] = False,
) -> None:
    """Calibrate Velodyne laser scanners against surveyed planes."""
    pass
