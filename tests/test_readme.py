"""The README's code is the example's."""

from pathlib import Path

ROOT = Path(__file__).parent.parent


def test_the_readmes_first_diagram_is_the_example() -> None:
    readme = (ROOT / "README.md").read_text()
    example = (ROOT / "examples" / "first_diagram.py").read_text().split("\n\n", 1)[1]
    indented = "\n".join(f"    {line}" if line else "" for line in example.strip().splitlines())
    assert indented in readme
