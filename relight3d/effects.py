"""The effects that a scene can have, by name, and how a person switches them: "lobes:table=off".

Recovery decides which exist; what it fits for one forced on, and what a frame drops for one forced off, go by the same
words.
"""

from collections.abc import Iterable, Mapping, Sequence

from relight3d.errors import InputError

Force = Mapping[tuple[str, int | str], bool]  # (effect, surface by number or name, -1 for all) -> on or off

SCENE = -1
SURFACE_EFFECTS = ("texture", "lobes", "detail", "mirror", "thrown")
SCENE_EFFECTS = ("indirect", "ambient", "residual", "background")
RAY_EFFECTS = ("shadows", "borders", "outlines", "second mirror", "soft shadows")  # of frames, not of the model
EFFECTS = (*RAY_EFFECTS, *SCENE_EFFECTS, *SURFACE_EFFECTS)


def parse_force(words: Iterable[str]) -> dict[tuple[str, int | str], bool]:
    """`effect=off`, `effect:surface=off` or `=on`, with the surface's name or number. Raises InputError for others."""
    force: dict[tuple[str, int | str], bool] = {}
    for word in words:
        what, _, state = word.partition("=")
        effect, _, where = what.partition(":")
        if state not in ("on", "off"):
            raise InputError("force", word, "effect=on, effect=off, or effect:surface=off")
        surface = SCENE if not where else int(where) if where.isdigit() else where
        force[effect.strip(), surface] = state == "on"
    return force


def surfaces_named(names: Sequence[str], effect: str, where: int | str) -> list[int]:
    """The surfaces that (effect, where) stands for; [-1] for an effect of the whole scene.

    `names` are the surfaces'. Raises InputError for an effect or a surface that does not exist.
    """
    kind = "lobes" if effect.startswith("lobe ") else effect
    if kind not in EFFECTS:
        raise InputError("force", effect, f"one of {', '.join(EFFECTS)}, or 'lobe 2' for one lobe")
    if kind not in SURFACE_EFFECTS:
        if where != SCENE:
            raise InputError("force", f"{effect} of {where}", "an effect of one surface", f"{effect} is the scene's")
        return [SCENE]
    if where == SCENE:
        return list(range(len(names)))
    if isinstance(where, str) and where in names:
        return [list(names).index(where)]
    if isinstance(where, int) and 0 <= where < len(names):
        return [where]
    raise InputError("force", f"surface {where!r}", f"a number below {len(names)}, or one of {', '.join(names)}")


def forced_states(names: Sequence[str], words: Iterable[str]) -> dict[tuple[str, int], bool]:
    """The effects that recovery is told to have or not, by number of the surface; -1: the scene's.

    Raises InputError for what recovery does not decide: the rays of a frame, and single lobes.
    """
    states: dict[tuple[str, int], bool] = {}
    for (effect, where), is_on in parse_force(words).items():
        surfaces = surfaces_named(names, effect, where)
        if effect not in (*SCENE_EFFECTS, *SURFACE_EFFECTS):
            kinds = ", ".join((*SCENE_EFFECTS, *SURFACE_EFFECTS))
            raise InputError("force", effect, f"one of {kinds}", "the others are switched when a frame is rendered")
        states |= {(effect, surface): is_on for surface in surfaces}
    return states
