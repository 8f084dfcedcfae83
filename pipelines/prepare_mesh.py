"""Stage 1: the mesh in its place, cleaned and subdivided; what was changed; and the result as PLY to look at.

    python pipelines/prepare_mesh.py data/desk --output output/stages/desk
"""

from pathlib import Path

from stages import CapturePath, Options, Stages
from start import start

from relight3d.io.meshes import write_mesh
from relight3d.progress import say
from relight3d.recover.run import RecoverOptions

CAPTURE, OUTPUT = Path("data/desk"), Path("output/stages/desk")
OPTIONS = RecoverOptions()


def main(capture: CapturePath = CAPTURE, output: Path = OUTPUT, options: Options = OPTIONS) -> None:
    stages = Stages(capture, output, options)
    made = stages.mesh
    write_mesh(output / "mesh.ply", made)
    report = made.report
    say("\n".join(stages.placed[1]) or "the photographs show the mesh in its place")
    say(f"{report.num_faces_in} faces in, {report.num_faces_out} out; {len(made.vertices)} vertices")
    for kind, count in report.changes.items():
        say(f"  {kind.replace('_', ' ')}: {count}")
    for note in report.notes:
        say(f"  {note}")
    say(f"{output / 'mesh.ply'}")


if __name__ == "__main__":
    start(main, __doc__)
