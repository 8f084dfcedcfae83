"""How accurate the whole method is, and what each part of it is worth: docs/accuracy.md and its picture.

    python pipelines/accuracy.py data/desk ../shared/captures/diligent_cat ../shared/captures/diligent_reading

Captures that are not there are left out. A row (one recovery, measured) is kept in the work folder and not made again;
`--again` makes all of them again, `--rows 24 8` only those named. About a minute a row.
"""

import time
from pathlib import Path
from typing import Annotated

import tyro
from accuracy.page import page
from accuracy.rows import ROWS, Store
from accuracy.run import measure
from stages import Options
from start import start

import relight3d
from relight3d.errors import InputError
from relight3d.io.files import write_text
from relight3d.progress import say
from relight3d.recover.run import RecoverOptions

SHARED = Path("../shared/captures")
CAPTURES = (Path("data/desk"), SHARED / "diligent_cat", SHARED / "diligent_reading")
WORK, DOCS = Path("output/accuracy"), Path("docs")
OPTIONS = RecoverOptions()


def main(
    captures: Annotated[tuple[Path, ...], tyro.conf.Positional] = CAPTURES,
    output: Path = WORK,
    docs: Path = DOCS,
    rows: tuple[str, ...] = tuple(row.name for row in ROWS),
    again: bool = False,
    options: Options = OPTIONS,
) -> None:
    there = [folder for folder in captures if (folder / "transforms.json").is_file()]
    if not there:  # else the page would be written anew, without a figure
        raise InputError("captures", ", ".join(map(str, captures)), "a capture folder, or more")
    read = {folder.name: relight3d.load_capture(folder) for folder in there}
    stores = {name: Store(output / name) for name in read}
    for row in [row for row in ROWS if row.name in rows]:
        for name, capture in read.items():
            has_truth = (capture.folder / "truth").is_dir()
            if (row.needs_truth and not has_truth) or (not again and stores[name].read(row.name)):
                continue
            begin = time.perf_counter()
            found = measure(row, capture, options, output / name, docs / "images")
            stores[name].write(row.name, found)
            psnr_db = found["psnr"]["relight3d"]["all"]
            say(f"{name}, {row.name}: {psnr_db:.2f} dB ({time.perf_counter() - begin:.0f} s)")
    write_text(docs / "accuracy.md", page(list(read.values()), stores))
    say(f"{docs / 'accuracy.md'}, {docs / 'images'}")


if __name__ == "__main__":
    start(main, __doc__)
