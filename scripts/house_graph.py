"""Draws the import graph of `core` into docs/images/house.svg, and its table into docs/development/house.md.

Nodes are the folders of `core` and the files beside them. A node stands one floor above the highest node that it
imports.
"""

from __future__ import annotations

import ast
import re
from functools import cache
from graphlib import TopologicalSorter
from html import escape
from pathlib import Path
from typing import Final

CHECKOUT: Final = Path(__file__).resolve().parents[1]
PICTURE: Final = CHECKOUT / "docs" / "images" / "house.svg"
PAGE: Final = CHECKOUT / "docs" / "development" / "house.md"
BEGIN, END = "<!-- Written by scripts/house_graph.py from the imports. -->", "<!-- End of what is written. -->"
CORE: Final = "furrowmap.core."
BOX: Final = (112, 34)
STEP: Final = (150, 92)

Graph = dict[str, set[str]]
"""Node → the nodes that it imports."""


def places(core: Path = CHECKOUT / "core") -> dict[str, Path]:
    """Node → its folder or file."""
    inside = sorted(p for p in core.iterdir() if p.suffix == ".py" or any(p.glob("*.py")))
    return {p.stem: p for p in inside if p.name != "__init__.py"}


@cache
def imported(path: Path) -> set[str]:
    """Full names that a file imports from `core`, wherever in it."""
    names = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
    return {name for name in names if name.startswith(CORE)}


def graph(nodes: dict[str, Path]) -> Graph:
    """Which node imports which."""
    files = {node: sorted(p.rglob("*.py")) if p.is_dir() else [p] for node, p in nodes.items()}
    ends = {node: {name.split(".")[2] for file in inside for name in imported(file)} for node, inside in files.items()}
    return {node: (below & set(nodes)) - {node} for node, below in ends.items()}


def floors(arrows: Graph) -> dict[str, int]:
    """Node → its floor: the longest way down to a node that imports nothing.

    Raises:
        graphlib.CycleError: nodes import each other in a circle.
    """
    height: dict[str, int] = {}
    for node in TopologicalSorter(arrows).static_order():
        height[node] = max((height[below] + 1 for below in arrows[node]), default=0)
    return height


def direct(arrows: Graph) -> Graph:
    """The arrows without those that a longer way implies."""
    reached: Graph = {}
    for node in TopologicalSorter(arrows).static_order():
        reached[node] = set(arrows[node]).union(*(reached[below] for below in arrows[node]))
    return {node: {b for b in below if not any(b in reached[o] for o in below - {b})} for node, below in arrows.items()}


def rows(arrows: Graph) -> list[list[str]]:
    """The nodes of each floor from left to right, each near the middle of what it is joined with."""
    height = floors(arrows)
    joined = {n: below | {m for m in arrows if n in arrows[m]} for n, below in direct(arrows).items()}
    laid = [sorted(n for n in height if height[n] == floor) for floor in range(max(height.values()) + 1)]
    for _ in range(20):
        x_of = {n: i - (len(row) - 1) / 2 for row in laid for i, n in enumerate(row)}
        middle = {n: sum(x_of[m] for m in joined[n]) / max(len(joined[n]), 1) for n in x_of}
        laid = [sorted(row, key=lambda n: (middle[n], n)) for row in laid]
    return laid


def picture(arrows: Graph) -> str:
    """The graph as SVG: arrows point down, to what is imported; those that a longer way implies are pale."""
    laid, strong = rows(arrows), direct(arrows)
    width, height = max(map(len, laid)) * STEP[0], len(laid) * STEP[1]
    at = {
        n: (width / 2 + (i - (len(row) - 1) / 2) * STEP[0], height - (floor + 0.5) * STEP[1])
        for floor, row in enumerate(laid)
        for i, n in enumerate(row)
    }
    lines = {True: [], False: []}
    for n in sorted(arrows):
        for below in sorted(arrows[n]):
            (x0, y0), (x1, y1) = (at[n][0], at[n][1] + BOX[1] / 2), (at[below][0], at[below][1] - BOX[1] / 2 - 5)
            bend = (y1 - y0) * 0.45
            path = f"M{x0:.0f} {y0:.0f}C{x0:.0f} {y0 + bend:.0f} {x1:.0f} {y1 - bend:.0f} {x1:.0f} {y1:.0f}"
            kind = "strong" if below in strong[n] else "pale"
            lines[kind == "strong"].append(f'<path class="{kind}" d="{path}"><title>{n} → {below}</title></path>')
    boxes = [
        f'<rect x="{x - BOX[0] / 2:.0f}" y="{y - BOX[1] / 2:.0f}" width="{BOX[0]}" height="{BOX[1]}" rx="5"/>'
        f'<text x="{x:.0f}" y="{y + 5:.0f}">{escape(n)}</text>'
        for n, (x, y) in sorted(at.items())
    ]
    return "\n".join([HEAD.format(width=width, height=height), *lines[False], *lines[True], *boxes, "</svg>", ""])


HEAD: Final = """\
<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" height="{height}">
<title>The folders of core and what they import</title>
<defs><marker id="tip" viewBox="0 0 8 8" refX="4" refY="4" markerWidth="7" markerHeight="7" markerUnits="userSpaceOnUse"
 orient="auto"><path d="M0 0L8 4L0 8z" fill="#4a3b2a"/></marker></defs>
<style>
path.strong {{ fill: none; stroke: #4a3b2a; stroke-width: 1.4; marker-end: url(#tip); }}
path.pale {{ fill: none; stroke: #d8cfc2; stroke-width: 1; }}
rect {{ fill: #f4efe6; stroke: #7a5c3a; stroke-width: 1.2; }}
text {{ font: 14px sans-serif; fill: #2b2118; text-anchor: middle; }}
</style>
<rect width="{width}" height="{height}" style="fill: white; stroke: none"/>"""


def table(nodes: dict[str, Path], arrows: Graph) -> str:
    """One line a node, the highest floor first: what it holds, and what it imports."""
    height = floors(arrows)
    lines = ["| floor | name | content | imports |", "| ---: | --- | --- | --- |"]
    for n in sorted(height, key=lambda n: (-height[n], n)):
        file = nodes[n] / "__init__.py" if nodes[n].is_dir() else nodes[n]
        content = (ast.get_docstring(ast.parse(file.read_text(encoding="utf-8"))) or "").split("\n")[0]
        below = ", ".join(f"`{b}`" for b in sorted(arrows[n])) or "–"
        lines.append(f"| {height[n]} | `{nodes[n].name}` | {content} | {below} |")
    many = sum(map(len, arrows.values()))
    return "\n".join([*lines, "", f"{len(arrows)} nodes, {many} arrows, {max(height.values()) + 1} floors."])


def page(nodes: dict[str, Path], arrows: Graph, written: str) -> str:
    """The page with the table as the source has it."""
    between = f"{BEGIN}\n\n{table(nodes, arrows)}\n\n{END}"
    return re.sub(f"{re.escape(BEGIN)}.*{re.escape(END)}", lambda _: between, written, flags=re.DOTALL)


if __name__ == "__main__":
    rooms = places()
    PICTURE.write_text(picture(graph(rooms)), encoding="utf-8")
    PAGE.write_text(page(rooms, graph(rooms), PAGE.read_text(encoding="utf-8")), encoding="utf-8")
