"""The commands put together, and how their help looks."""

from __future__ import annotations

from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup

from luxel.cli import bake, demo, diff, filter, form_factors, hardware, info, optimize, render, study

_EPILOG = "Start here:\n  luxel demo\n  luxel render model.glb -o model.png\n  luxel render --help"


class Group(TyperGroup):
    """Plain help, because it must come at once."""

    def format_epilog(self, ctx: Any, formatter: Any) -> None:
        """As it stands, not wrapped."""
        formatter.write(f"\n{self.epilog}\n")


class Command(TyperCommand):
    """Help with the options under headings (typer's `rich_help_panel`), and an example."""

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """One section a heading, in the order in which they come first."""
        sections: dict[str, list[tuple[str, str]]] = {}
        parameter: Any  # typer's own parameters have more than click's
        for parameter in self.get_params(ctx):
            record = parameter.get_help_record(ctx)
            if record is not None:
                argument = parameter.param_type_name == "argument"
                heading = getattr(parameter, "rich_help_panel", None) or ("Arguments" if argument else "Options")
                name = (parameter.metavar or parameter.human_readable_name) if argument else record[0]
                sections.setdefault(heading, []).append((name, record[1].replace("  [required]", "")))
        for heading, records in sections.items():
            with formatter.section(heading):
                formatter.write_dl(records, col_max=34)

    def format_epilog(self, ctx: Any, formatter: Any) -> None:
        """As it stands, not wrapped."""
        formatter.write(f"\n{self.epilog}\n")


app = typer.Typer(
    cls=Group,
    add_completion=False,
    invoke_without_command=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
    epilog=_EPILOG,
)
for module in (demo, render, bake, form_factors, info, diff, filter, optimize, study):
    name = module.__name__.rpartition(".")[2]
    app.command(name.replace("_", "-"), cls=Command, epilog=f"Example:\n  {module.EXAMPLE}")(getattr(module, name))
circuit = typer.Typer(cls=Group, rich_markup_mode=None, epilog=f"Example:\n  {hardware.EXAMPLE}", help=hardware.HELP)
for function, example in hardware.COMMANDS:
    circuit.command(function.__name__, cls=Command, epilog=f"Example:\n  {example}")(function)
app.add_typer(circuit, name="hardware")


def _version(wanted: bool) -> None:
    if wanted:
        from luxel import __version__

        typer.echo(f"luxel {__version__}")
        raise typer.Exit


@app.callback()
def start(
    context: typer.Context,
    version: Annotated[bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version and exit.")] = False,
    traceback: Annotated[bool, typer.Option("--traceback", help="Show where in the code an error came from.")] = False,
) -> None:
    """Draw triangle scenes to exact, anti-aliased pictures: no display, driver or GPU needed."""
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())


def command() -> Any:
    """The click command that runs everything."""
    return typer.main.get_command(app)
