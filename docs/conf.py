"""Settings of the documentation site: `sphinx-build -W -b html docs FOLDER` (`make site`).

Pages that other files contain already (configuration, changes, contributing), or that the code
knows best (commands, public names), are written to `docs/generated` when the site is built.
"""

from __future__ import annotations

import inspect
import re
from pathlib import Path
from typing import Any

import typer.cli
from docutils import nodes
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.application import Sphinx

import velocal
from velocal.cli import app as commands

ROOT = Path(__file__).resolve().parents[1]

project = "velocal"
author = copyright = "the developers of velocal"
version = release = velocal.__version__
extensions = ["myst_parser", "numpydoc", "sphinx.ext.autodoc"]
myst_enable_extensions = ["amsmath", "dollarmath", "deflist"]
myst_heading_anchors = 4
html_theme = "furo"
html_title = f"velocal {release}"
html_copy_source = False
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_show_sphinx = False
html_math_renderer = "mathml"
autodoc_typehints = "none"
numpydoc_show_class_members = False

#: Pages of the project that stand elsewhere: file, and the page that shows it.
ELSEWHERE = {
    "config/README.md": "configuration.md",
    "results/README.md": "results.md",
    "CONTRIBUTING.md": "contributing.md",
    "CHANGELOG.md": "changelog.md",
}


def _linked(text: str, folder: str, to: str) -> str:
    """Let the links of a page lead to pages of the site.

    `folder` is that of the page in the project, `to` the way from the page of the site to `docs`.
    """

    def target(match: re.Match[str]) -> str:
        name, anchor = match[1], match[2] or ""
        path = (ROOT / folder / name).resolve().relative_to(ROOT).as_posix()
        if path in ELSEWHERE:
            return f"]({to}generated/{ELSEWHERE[path]}{anchor})"
        if path == "README.md":
            return f"]({to}index.md{anchor})"
        return f"]({to}{path.removeprefix('docs/')}{anchor})"

    text = re.sub(r"\]\(((?!\w+:)[\w./-]+\.md)(#[\w-]+)?\)", target, text)
    # Other files of the project are not part of the site.
    return re.sub(r"\[([^\]]+)\]\((?!\w+:)[\w./-]+\.(?:json|yaml|tsv|csv)\)", r"\1", text)


def _api() -> str:
    """All public names, functions first, as `velocal.__all__` has them."""
    parts = ["# Python", "", velocal.__doc__.split("\n\n")[0] if velocal.__doc__ else "", ""]
    kinds: dict[str, list[str]] = {"function": [], "class": [], "data": []}
    for name in velocal.__all__:
        if name.startswith("_"):
            continue
        found = getattr(velocal, name)
        kind = "class" if inspect.isclass(found) else "function" if callable(found) else "data"
        kinds[kind].append(name)
    for kind, heading in (("function", "Functions"), ("class", "Classes"), ("data", "Tables")):
        parts += [f"## {heading}", "", "```{eval-rst}"]
        for name in kinds[kind]:
            exception = kind == "class" and issubclass(getattr(velocal, name), Exception)
            parts += [f".. auto{'exception' if exception else kind}:: velocal.{name}"]
            if kind == "class":
                parts += ["   :members:"]
            if kind == "data":
                parts += ["   :no-value:"]
            parts += [""]
        parts += ["```", ""]
    return "\n".join(parts)


def _commands() -> str:
    """Help of all commands, as `velocal --help` shows it."""
    command = typer.main.get_command(commands)
    with command.make_context("velocal", [], resilient_parsing=True) as context:
        text = typer.cli.get_docs_for_click(obj=command, ctx=context, name="velocal")
    return re.sub(r"^# `velocal`", "# Commands", text)


def _write_pages(site: Sphinx) -> None:
    folder = Path(site.srcdir) / "generated"
    folder.mkdir(exist_ok=True)
    texts = {"api.md": _api(), "commands.md": _commands()}
    for file, page in ELSEWHERE.items():
        text = (ROOT / file).read_text(encoding="utf-8")
        texts[page] = _linked(text, str(Path(file).parent), "../")
    for name, text in texts.items():
        path = folder / name
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")


def _read(site: Sphinx, page: str, source: list[str]) -> None:
    if not page.startswith("generated/"):
        source[0] = _linked(source[0], "docs", "")


def _mathml(self: Any, node: nodes.math | nodes.math_block, *, block: bool) -> None:
    """Write a formula as MathML: browsers show it without scripts and without a network."""
    text = re.sub(r"\\tag\{(\d+)\}", r"\\qquad (\1)", node.astext())
    text = re.sub(r"\\(sin|cos|log) ", r"\\\1\\,", text)
    math = tex2mathml(text, as_block=block)
    self.body.append(f'<div class="math">{math}</div>' if block else math)
    raise nodes.SkipNode


def setup(site: Sphinx) -> None:
    """Add the pages of other files, and the renderer of formulas."""
    site.connect("builder-inited", _write_pages)
    site.connect("source-read", _read)
    site.add_html_math_renderer(
        "mathml",
        (lambda self, node: _mathml(self, node, block=False), None),
        (lambda self, node: _mathml(self, node, block=True), None),
    )
