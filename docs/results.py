"""Puts the tables and pictures of finished experiments into RESULTS.md.

    manylight experiment configs/experiments/nave.ron --out out/nave
    python3 docs/results.py out/nave ...

A folder's name is that of its experiment. RESULTS.md has a place for each,

    <!-- results of nave: crops, error-cpu -->
    <!-- end of results -->

between whose lines all is replaced by what summary.md says, with those of its pictures whose names end in what follows the
colon. They go to docs/results/NAME/. What is written around these places is left as it is.
"""

import re
import shutil
import sys
from pathlib import Path

DOCS = Path(__file__).parent
RESULTS = DOCS.parent / "RESULTS.md"
PLACE = "(<!-- results of {}(?:: (.*?))? -->\n).*?(<!-- end of results -->)"
PICTURE = re.compile(r"!\[(.*?)\]\(plots/(.*?)\)")


def section(folder, name, wanted):
    """What takes the place's place; copies the pictures."""
    text = (folder / "summary.md").read_text()
    _title, text = text.split("\n", 1)
    text, _, pictures = text.partition("\n## Pictures\n")
    text = text.replace("\n## ", "\n### ")
    copies = DOCS / "results" / name
    shutil.rmtree(copies, ignore_errors=True)
    for ending in wanted:
        found = [p for p in PICTURE.findall(pictures) if Path(p[1]).stem.endswith(ending)]
        if not found:
            sys.exit(f"{folder}/summary.md: there is no picture whose name ends in {ending!r}")
        for caption, file in found:
            copies.mkdir(parents=True, exist_ok=True)
            shutil.copy(folder / "plots" / file, copies / file)
            text += f"\n![{caption}](docs/results/{name}/{file})\n"
    return text.strip("\n")


def main():
    if not sys.argv[1:]:
        sys.exit(__doc__)
    results = RESULTS.read_text()
    for folder in map(Path, sys.argv[1:]):
        name = folder.resolve().name
        place = re.compile(PLACE.format(re.escape(name)), re.DOTALL)
        found = place.search(results)
        if not found:
            sys.exit(f"{RESULTS}: there is no place for results of {name}")
        start, wanted, end = found.groups()
        wanted = [ending.strip() for ending in (wanted or "").split(",") if ending.strip()]
        new = f"{start}\n{section(folder, name, wanted)}\n\n{end}"
        results = results[: found.start()] + new + results[found.end() :]
    written = RESULTS.with_suffix(".md.new")
    written.write_text(results)
    written.replace(RESULTS)


if __name__ == "__main__":
    main()
