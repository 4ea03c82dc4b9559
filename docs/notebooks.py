"""Run the notebooks and write each as a page: code, what it prints, its tables and figures.

Run by mkdocs (plugin gen-files) at every build; `DOCS_NOTEBOOKS=code` leaves the outputs out.
"""

import ast
import contextlib
import io
import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).with_name("notebooks")  # they run here, as where they are opened

Figures = list[bytes]


def cells_of(path: Path) -> Iterator[tuple[str, str]]:
    """Kind ("markdown" or "code") and text of each cell."""
    for cell in json.loads(path.read_text("utf-8"))["cells"]:
        yield cell["cell_type"], "".join(cell["source"])


def executed(path: Path, *, run: bool = True) -> tuple[str, Figures]:
    """A notebook as Markdown, and its figures (PNG) in order; raises what a cell raises.

    Parameters
    ----------
    path : Path
        The notebook.
    run : bool
        False: code without outputs.
    """
    known: dict[str, Any] = {}
    parts, figures = [], Figures()
    for kind, text in cells_of(path):
        if kind == "markdown":
            parts.append(text)
            continue
        parts.append(f"```python\n{text}\n```")
        if run:
            with contextlib.chdir(FOLDER):
                printed, drawn = _run(text, known, path.name)
            parts += [printed] if printed else []
            for png in drawn:
                parts.append(f"![Figure {len(figures) + 1}]({path.stem}-{len(figures) + 1}.png)")
                figures.append(png)
    return "\n\n".join(parts) + "\n", figures


def _run(code: str, known: dict[str, Any], name: str) -> tuple[str, Figures]:
    """Run a cell as a notebook does: what it prints, its last value, its figures."""
    tree = ast.parse(code, name)
    last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
    printed = io.StringIO()
    value = None
    with contextlib.redirect_stdout(printed):
        exec(compile(tree, name, "exec"), known)
        if isinstance(last, ast.Expr):
            value = eval(compile(ast.Expression(last.value), name, "eval"), known)
    return _shown(printed.getvalue(), value), _figures()


def _shown(printed: str, value: Any) -> str:
    if hasattr(value, "to_html") and not hasattr(value, "data_vars"):
        return printed + str(value.to_frame().to_html() if value.ndim == 1 else value.to_html())
    is_axes = type(value).__module__.startswith("matplotlib") or _holds_axes(value)
    text = printed + ("" if value is None or is_axes else repr(value))
    return f"```text\n{text.rstrip()}\n```" if text.strip() else ""


def _holds_axes(value: Any) -> bool:
    return str(getattr(value, "dtype", "")) == "object"


def _figures() -> Figures:
    from matplotlib import pyplot

    drawn = []
    for number in pyplot.get_fignums():
        written = io.BytesIO()
        pyplot.figure(number).savefig(written, format="png", dpi=90, bbox_inches="tight")
        drawn.append(written.getvalue())
    pyplot.close("all")
    return drawn


def write_pages() -> None:
    """Write them as mkdocs' plugin takes them."""
    import matplotlib
    import mkdocs_gen_files

    matplotlib.use("agg")
    run = os.environ.get("DOCS_NOTEBOOKS") != "code"
    for path in sorted(FOLDER.glob("*.ipynb")):
        text, figures = executed(path, run=run)
        with mkdocs_gen_files.open(f"notebooks/{path.stem}.md", "w") as page:
            page.write(text)
        for number, png in enumerate(figures, start=1):
            name = f"notebooks/{path.stem}-{number}.png"
            with mkdocs_gen_files.open(name, "wb") as picture:
                picture.write(png)


if __name__ == "<run_path>":  # by the plugin, not by a test
    write_pages()
