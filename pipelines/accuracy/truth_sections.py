"""The sections of docs/accuracy.md that need a capture's truth."""

from accuracy.tables import table
from accuracy.verdicts import Rows
from relight3d.evaluate.baselines import BASELINES
from relight3d.evaluate.run import OURS

LABELLED = {"24": "with labels", "no_labels": "without labels", "8": "8 photographs"}


def kinds_section(name: str, rows: Rows) -> str:
    """What every true surface was taken for."""
    which = [row for row in LABELLED if "kinds" in rows.get(row, {})]
    lines = []
    for index, given in enumerate(rows["24"]["kinds"]):
        cells = [given["name"], given["kind"]]
        for row in which:
            each = rows[row]["kinds"][index]
            cells.append(f"{each['found']}, {100 * each['share']:.0f} %, {each['regions']}")
        lines.append(cells)
    columns = ["surface", "is", *(LABELLED[row] for row in which)]
    return f"""## What the surfaces are: {name}

The kind found at most of the surface's pixels; the share of its pixels that are right, in a region of exactly the true kind;
and the number of regions that hold more than 2 % of it.

{table(columns, lines)}"""


def albedo_section(name: str, rows: Rows) -> str:
    """Relative errors of the albedo."""
    which = [row for row in LABELLED if "albedo" in rows.get(row, {})]
    lines = []
    for index, given in enumerate(rows["24"]["albedo"]):
        cells = [given["name"], given["kind"]]
        for row in which:
            each = rows[row]["albedo"][index]
            cells.append(" / ".join(f"{100 * each[key]:.1f}" for key in ("surface", "median", "most")))
        lines.append(cells)
    worst = max(rows["24"]["albedo"], key=lambda each: each["surface"])
    columns = ["surface", "kind"]
    columns += [LABELLED[row] for row in which]
    return f"""## Albedo: {name}

Relative error in per cent against the truth, as three figures: the surface's one albedo (of its regions, weighted by pixels)
against the true mean; the per-pixel albedo against the true one, median over pixels and colours; and its 90th percentile.
The truth is that of the pixel's centre, a photograph shows the mean over the pixel: at the borders of marks they differ.
Where the albedo is off and the frames are right, the light that the surface gets is off the other way. Worst surface with
labels: {worst["name"]}, {100 * worst["surface"]:.1f} %.

{table(columns, lines)}"""


def mirror_section(name: str, rows: Rows) -> str:
    """The mirror's image at held-out lights."""
    which = [row for row in ("24", "8") if "mirror" in rows.get(row, {})]
    if not which:
        return ""
    lines = []
    for row in which:
        given = rows[row]["mirror"]
        over = given[OURS] - max(given[each] for each in BASELINES)
        lines.append([row, *(f"{given[each]:.2f}" for each in (OURS, *BASELINES)), f"{over:+.2f}"])
    columns = ["photographs", OURS, *BASELINES, "above the best"]
    return f"""## The mirror's image: {name}

PSNR in dB over the pixels of the mirror, mean over the held-out frames with one light.

{table(columns, lines)}"""


def detail_section(name: str, rows: Rows) -> str:
    """Figure 4 of the paper again."""
    if "no_detail" not in rows:
        return ""
    relief = rows["no_detail"]["relief"]
    lines = []
    for words, where in (("where the lobe is strong", "region"), ("the same, clear of shadow borders", "clear")):
        for more, tail in (("", ""), (", no residual", ", frames without the residual")):
            errors = relief[where]["all"]
            off = 1 - errors["with" + more] / errors["without" + more]
            values = [f"{errors[which + more]:.4f}" for which in ("without", "with")]
            lines.append([words + tail, *values, f"{100 * off:.0f} %"])
    columns = ["pixels", "error without detail", "with detail", "taken off"]
    frames = relief["region"]["frames"]
    worse = [shot for shot, a, b in zip(relief["names"], frames["without"], frames["with"]) if a and b > a]
    warned = (
        f"Detail makes the region worse in {', '.join(worse)}." if worse else "Detail makes no frame's region worse."
    )
    each = [
        [shot, f"{num:,}", *(_number(frames[which][k]) for which in ("without", "with"))]
        for k, (shot, num) in enumerate(zip(relief["names"], relief["region"]["pixels"]))
    ]
    return f"""## Detail, as in the paper's Figure 4: {name}

The surfaces that have a relief in the photographs and none in the mesh, where the lobes are above half of their largest
value in the frame (the lobes of the recovery without detail say where). *Without detail* is a recovery of its own
(`detail.mode=off`), so that the residual may make up for it. The error is the root mean square of display values, over all
held-out frames with one light.

![without detail, with detail, the photograph, and the differences](images/detail.png)

The picture is a part of frame {relief["shown"]}.

{table(columns, lines)}
Frame by frame, where the lobe is strong. {warned}

{table(["frame", "pixels", "without detail", "with detail"], each)}"""


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.4f}"
