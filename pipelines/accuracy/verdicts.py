"""What was asked of the method, what the rows say, and whether it is reached."""

from accuracy.rows import Found
from relight3d.evaluate.baselines import BASELINES
from relight3d.evaluate.run import OURS

Rows = dict[str, Found]  # of one capture, by the row's name
Line = tuple[str, str, str, str]  # asked, least, found, verdict
REACHED, SHORT = "reached", "**falls short**"
REAL_DB = {"24": 2.0, "8": 5.0}  # above the best baseline, on photographs of real objects
MADE_DB = {"24": 6.0, "8": 8.0}  # on the path-traced capture


def best_baseline(found: Found, frames: str) -> tuple[str, float]:
    """The baseline with the highest PSNR over these frames."""
    name = max(BASELINES, key=lambda each: found["psnr"][each][frames])
    return name, found["psnr"][name][frames]


def lines_of(name: str, rows: Rows, has_truth: bool) -> list[Line]:
    """The lines of one capture; a row that has not been measured gives none."""
    lines = []
    for row, least in (MADE_DB if has_truth else REAL_DB).items():
        if row in rows:
            best, db = best_baseline(rows[row], "captured view")
            over = rows[row]["psnr"][OURS]["captured view"] - db
            lines.append(_at_least(f"{name}: above the best baseline ({best}), {row} photographs", least, over, "dB"))
    return [*_of_truth(name, rows), *lines] if has_truth else lines


def _of_truth(name: str, rows: Rows) -> list[Line]:
    lines = []
    for row, words in (("24", "with the mesh's labels"), ("no_labels", "without labels")):
        if row in rows:
            given = rows[row]["kinds"]
            right = sum(each["share"] > 0.9 for each in given)
            lines.append(_line(f"{name}: kinds right {words}", f"{len(given)}", f"{right}", right == len(given)))
    if "24" not in rows:
        return lines
    full, ours = rows["24"], rows["24"]["psnr"][OURS]
    for each in full["albedo"]:
        if each["kind"] == "textured":
            what = f"{name}: texture of the {each['name']}, median error of a pixel"
            lines.append(_line(what, "at most 5 %", f"{100 * each['median']:.1f} %", each["median"] <= 0.05))
    if "mirror" in full:
        over = full["mirror"][OURS] - max(full["mirror"][each] for each in BASELINES)
        lines.append(_at_least(f"{name}: the mirror's image above the best baseline", 6, over, "dB"))
    lines.append(_at_least(f"{name}: all held-out frames", 32, ours["all"], "dB"))
    if "two_lights" in ours:
        less = ours["one_light"] - ours["two_lights"]
        lines.append(_line(f"{name}: two lights below one", "at most 1 dB", f"{less:.1f} dB", less <= 1))
    if "new_view" in ours:
        lines.append(_at_least(f"{name}: new viewpoints", 28, ours["new_view"], "dB"))
    if "no_detail" in rows:
        errors = rows["no_detail"]["relief"]["region"]["all"]
        lines.append(_at_least(f"{name}: error that detail takes off the highlight", 30, _off(errors), "%"))
    return lines


def _off(errors: dict[str, float]) -> float:
    return 100 * (1 - errors["with"] / errors["without"])


def _at_least(what: str, least: float, found: float, unit: str) -> Line:
    return _line(what, f"at least {least:g} {unit}", f"{found:.1f} {unit}", found >= least)


def _line(what: str, least: str, found: str, is_reached: bool) -> Line:
    return what, least, found, REACHED if is_reached else SHORT
