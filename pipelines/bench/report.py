"""The figures as a Markdown table, and the gate against a committed baseline."""

MARGIN = 1.3  # a ratio may be 30 % above the baseline (STYLE 35)


def table(case: dict) -> str:
    """Medians with their spread, then the ratios."""
    lines = [f"### {case['faces']:,} faces, {case['size']}, medians of {case['rounds']} rounds", ""]
    lines += ["| what | ms | quartiles apart |", "|---|---|---|"]
    for name, milliseconds in case["milliseconds"].items():
        lines.append(f"| {name} | {milliseconds:.2f} | {case['spread'][name]:.2f} |")
    lines += ["", "| ratio | by the clock | by the cores | at most |", "|---|---|---|---|"]
    for name, entry in case["ratios"].items():
        limit = entry["at most"] or ""
        lines.append(f"| {name} | {entry['wall']:.2f} | {entry['cores']:.2f} | {limit} |")
    return "\n".join(lines)


def summary(cases: list[dict]) -> str:
    """One row a case: each ratio by the clock, by the cores in brackets, and the memory of a view's buffers."""
    names = list(dict.fromkeys(name for case in cases for name in case["ratios"]))
    lines = ["| ratio | " + " | ".join(f"{case['faces']:,} faces, {case['size']}" for case in cases) + " |"]
    lines += ["|---" * (len(cases) + 1) + "|"]
    for name in names:
        each = [case["ratios"].get(name) for case in cases]
        cells = ["" if entry is None else f"{entry['wall']:.2f} ({entry['cores']:.2f})" for entry in each]
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    return "\n".join([*lines, "| buffers, MB | " + " | ".join(f"{case['buffers_mb']:.0f}" for case in cases) + " |"])


def gate(cases: list[dict], baseline: list[dict]) -> list[str]:
    """A line for each ratio that is 30 % above the baseline's; what only one of the two has passes (Mitsuba's, say).

    By the cores, which a busy machine hardly changes.
    """
    known = {(case["faces"], case["size"]): case["ratios"] for case in baseline}
    slower = []
    for case in cases:
        before_by_name = known.get((case["faces"], case["size"]), {})
        for name in before_by_name.keys() & case["ratios"].keys():
            before, now = before_by_name[name], case["ratios"][name]["cores"]
            if now > MARGIN * before["cores"]:
                slower.append(f"{case['faces']} faces, {case['size']}: {name} was {before['cores']:.2f}, is {now:.2f}")
    return slower
