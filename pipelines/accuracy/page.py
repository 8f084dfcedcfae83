"""docs/accuracy.md, from the rows."""

from collections.abc import Sequence

from accuracy import ablation_sections, truth_sections
from accuracy.rows import FAULTS, ROWS, WORDS, Store
from accuracy.tables import table
from accuracy.verdicts import REAL_DB, SHORT, Rows, best_baseline, lines_of
from relight3d.evaluate.baselines import BASELINES
from relight3d.evaluate.run import OURS
from relight3d.records import Capture

HEAD = """# How accurate it is

Written by `python pipelines/accuracy.py {folders}`; do not edit by hand.
Measures are those of `relight3d.evaluate`: one exposure for a capture (the 99.5th percentile of the held-out values is
white), sRGB curve, PSNR over the pixels that see the mesh, mean over the held-out frames. `data/desk` is path-traced by a
renderer that shares no code with relight3d, and its truth is known. The DiLiGenT captures are photographs of real objects;
they are no part of this project.

{summary}"""
GROUPS = ("all", "captured view", "one_light", "two_lights", "new_view", "worst")


def page(captures: Sequence[Capture], stores: dict[str, Store]) -> str:
    """The whole page; what has not been measured has no section."""
    names = [capture.folder.name for capture in captures]
    rows = {name: _read(stores[name]) for name in names}
    has_truth = {capture.folder.name: (capture.folder / "truth").is_dir() for capture in captures}
    lines = [line for name in names for line in lines_of(name, rows[name], has_truth[name])]
    short = [line for line in lines if line[3] == SHORT]
    summary = f"{len(lines) - len(short)} of {len(lines)} figures that were asked for are reached.\n\n"
    parts = [
        HEAD.format(
            folders=" ".join(str(capture.folder) for capture in captures),
            summary=summary + table(("what", "asked", "found", "verdict"), lines),
        )
    ]
    parts += [held_out(rows)]
    for name in names:
        if has_truth[name] and "24" in rows[name]:
            parts += [truth_sections.kinds_section(name, rows[name]), truth_sections.albedo_section(name, rows[name])]
            parts += [truth_sections.mirror_section(name, rows[name]), truth_sections.detail_section(name, rows[name])]
    parts += [where_the_error_is(rows), why_short(rows, has_truth), robustness(rows)]
    parts += [ablation_sections.of_frames(rows), ablation_sections.of_recoveries(rows), code_note(rows)]
    return "\n".join(part for part in parts if part)


def _read(store: Store) -> Rows:
    found = {row.name: store.read(row.name) for row in ROWS}
    return {name: each for name, each in found.items() if each is not None}


def held_out(rows: dict[str, Rows]) -> str:
    """PSNR of every method over every group of frames, with 24 and with 8 photographs."""
    cells = []
    for name, found in rows.items():
        for row in ("24", "8"):
            for method in (OURS, *BASELINES) if row in found else ():
                given = dict(found[row]["psnr"][method])
                given.setdefault("one_light", given.get("", float("nan")))
                if method != OURS:  # "all" and "worst" of a baseline would be of other frames than ours
                    given.pop("all")
                    given.pop("worst")
                values = [f"{given[group]:.2f}" if group in given else "" for group in GROUPS]
                cells.append((f"{name}, {found[row]['photographs']}", method, *values))
    text = """## Held-out photographs

PSNR in dB. A baseline interpolates each pixel over the lights; it cannot leave the captured viewpoint, so *captured view*
is the column to compare. The 8 photographs are evenly spread through the list of 24; the lights-off one stays where there
is one.

"""
    words = ("all", "captured view", "one light", "two lights", "new view", "worst frame")
    return text + table(("capture, photographs", "method", *words), cells)


def where_the_error_is(rows: dict[str, Rows]) -> str:
    """PSNR by kind of pixel, ours and RBF's."""
    cells = []
    for name, found in rows.items():
        for row in ("24", "8"):
            for place, each in found.get(row, {}).get("places", {}).items():
                shares = [f"{100 * each[key]:.0f} %" for key in ("pixels", "error")]
                over = each[OURS] - each["rbf"]
                cells.append(
                    (f"{name}, {row}", place, *shares, f"{each[OURS]:.1f}", f"{each['rbf']:.1f}", f"{over:+.1f}")
                )
    text = """## Where the error is

Held-out frames with one light at the captured viewpoint. Each pixel is in one class: within 2 pixels of a border between
seen and unseen light (cast or attached shadows, outlines with them); where the lobes carry more than half of the radiance;
other lit pixels; and pixels without direct light, mirrors among them.

"""
    columns = (
        "capture, photographs",
        "pixels",
        "share",
        "of the squared error",
        "relight3d dB",
        "RBF dB",
        "difference",
    )
    return text + table(columns, cells)


def why_short(rows: dict[str, Rows], has_truth: dict[str, bool]) -> str:
    """For each photographed capture that is short of its aim: what the aim would take, and where the error lies."""
    lines = []
    for name, found in rows.items():
        for row, least in REAL_DB.items() if not has_truth[name] else ():
            if row not in found or "24" not in found:
                continue
            best, db = best_baseline(found[row], "captured view")
            full = found["24"]["psnr"][OURS]["captured view"]
            if found[row]["psnr"][OURS]["captured view"] >= db + least:
                continue
            place, most = max(found[row]["places"].items(), key=lambda each: each[1]["error"])
            lines.append(
                f"- {name}, {row} photographs: {least:g} dB above {best} would be {db + least:.1f} dB. {OURS} has "
                f"{full:.1f} dB with all 24. Of the squared error {100 * most['error']:.0f} % are in the class "
                f"'{place}' ({100 * most['pixels']:.0f} % of the pixels), where {OURS} is {most[OURS] - most['rbf']:.1f} dB "
                f"above RBF; pixels without direct light, where interpolation fails, are "
                f"{100 * found[row]['places']['no direct light']['pixels']:.0f} %."
            )
    text = """## Where real captures fall short, and why

The objects of DiLiGenT are lit from within 44 degrees of the viewing direction, so that few pixels are ever in shadow, and a
pixel that stays lit is what interpolation is good at.

"""
    return text + "\n".join(lines) + "\n" if lines else ""


def robustness(rows: dict[str, Rows]) -> str:
    """What each fault of the photographs costs."""
    cells = []
    for name, found in rows.items():
        for fault in FAULTS if "24" in found else ():
            if fault in found:
                clean, spoilt = found["24"]["psnr"][OURS], found[fault]["psnr"][OURS]
                _, before = best_baseline(found["24"], "captured view")
                best, after = best_baseline(found[fault], "captured view")
                lost = [f"{clean[group] - spoilt[group]:.2f}" for group in ("all", "captured view")]
                values = (f"{spoilt['all']:.2f}", *lost, f"{after:.2f} ({best})", f"{before - after:.2f}")
                cells.append((f"{name}: {WORDS[fault]}", *values))
    text = """## Faults of the photographs

The training photographs or the mesh are spoilt, the held-out photographs are not. *Lost* is against the clean capture.

"""
    notes = [
        f"{name}, {WORDS[fault]}: the model warns that {warning}."
        for name, found in rows.items()
        for fault in FAULTS
        if "24" in found and fault in found
        for warning in _new(found[fault]["warnings"], found["24"]["warnings"])
    ]
    columns = ("fault", "dB", "lost", "lost, captured view", "best baseline dB", "it loses")
    return text + table(columns, cells) + "".join(f"\n{note}\n" for note in notes) if cells else ""


def _new(warnings: list[str], known: list[str]) -> list[str]:
    """Warnings of a kind (by its first words) that the clean capture does not give."""
    kinds = {warning[:20] for warning in known}
    return [warning for warning in warnings if warning[:20] not in kinds]


def code_note(rows: dict[str, Rows]) -> str:
    """Says so where rows were measured with different states of the library."""
    states = {found["code"][:8] for each in rows.values() for found in each.values()}
    if len(states) < 2:
        return ""
    return f"Rows on this page were measured with {len(states)} states of the library, `--again` makes them equal.\n"
