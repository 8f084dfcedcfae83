"""The sections of docs/accuracy.md that say what each effect is worth, and what it costs."""

import numpy as np

from accuracy.ablation import NUM_PAIRS
from accuracy.rows import RECOVERED_WITHOUT, WORDS
from accuracy.tables import table
from accuracy.verdicts import Rows
from relight3d.evaluate.run import OURS


def of_frames(rows: dict[str, Rows]) -> str:
    """Effects taken out of the frames of one model."""
    text = f"""## Each effect left out of the frames

One model; nothing is fitted again. dB lost over the held-out frames of the captured viewpoint, with the standard error of
the mean over frames. Frames with and without the effect are rendered in turn, {NUM_PAIRS} of each, and the medians compared;
milliseconds are that share of the full frame's median over all lines. Texture, detail and ambient light change numbers and
not work: their lines show how large the noise of these times is. A mirror's rays include those of the light it throws. An
effect that is not listed is not in that model.
"""
    parts = []
    for name, found in rows.items():
        lines = found.get("24", {}).get("ablation", [])
        if not lines:
            continue
        full_ms = float(np.median([each["full_ms"] for each in lines]))
        cells = []
        for each in sorted(lines, key=lambda each: -each["db"]):
            saved = 1 - each["less_ms"] / each["full_ms"]
            lost = f"{each['db']:.2f} ± {each['scatter']:.2f}"
            cells.append(
                (each["effect"], lost, f"{100 * saved:.0f} %", f"{saved * full_ms:.1f}", f"{each['rays_saved']:,}")
            )
        head = f"\n**{name}**: a full frame takes {full_ms:.1f} ms and casts {lines[0]['rays']:,} rays.\n\n"
        parts.append(head + table(("without", "dB lost", "time saved", "ms saved", "rays saved"), cells))
    return text + "".join(parts) if parts else ""


def of_recoveries(rows: dict[str, Rows]) -> str:
    """Parts of the recovery left out, and the rest fitted without them."""
    parts = []
    for name, found in rows.items():
        left_out = [row for row in RECOVERED_WITHOUT if row in found]
        if "24" not in found or not left_out:
            continue
        full, lines = found["24"]["psnr"][OURS], []
        groups = [group for group in ("all", "captured view", "new_view") if group in full]
        for row in left_out:
            lost = [f"{full[group] - found[row]['psnr'][OURS][group]:.2f}" for group in groups]
            lines.append((WORDS[row], *lost))
        columns = ("recovered without", *(f"dB lost, {group.replace('_', ' ')}" for group in groups))
        parts.append(f"\n**{name}**\n\n" + table(columns, lines))
    text = """## Each part left out of the recovery

Recovered again without it, so that the rest makes up for it as far as it can: the residual for texture, for instance, which
is why texture seems to be worth so little here. Neither the lobes nor light that mirrors throw can be made up for.
"""
    return text + "".join(parts) if parts else ""
