"""A generated page of several sections, each rewritten by its own script."""

import re
from pathlib import Path

PAGE = Path(__file__).parents[2] / "docs" / "stability.md"
TITLE = "# Hard cases\n\nGenerated; each section names the command that makes it.\n"
ORDER = ("cases", "degradation")


def write_section(name: str, text: str) -> None:
    """Put `text` in the page in place of the section of that name; the others stay."""
    old = PAGE.read_text() if PAGE.exists() else ""
    found = dict(re.findall(r"<!-- begin (\w+) -->\n(.*?)<!-- end \1 -->", old, re.DOTALL))
    found[name] = f"\n{text.strip()}\n\n"
    parts = [f"<!-- begin {key} -->\n{found[key]}<!-- end {key} -->\n" for key in ORDER if key in found]
    PAGE.parent.mkdir(parents=True, exist_ok=True)
    PAGE.write_text("\n".join([TITLE, *parts]))


def table(header: list[str], rows: list[list[str]]) -> str:
    """A Markdown table."""
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join("| " + " | ".join(cell.replace("|", "/") for cell in line) + " |" for line in lines)
