"""Every format gives back the mesh that was put in; every broken file gives one clear line."""

import base64
import json
import struct

import numpy as np
import pytest

from relight3d.errors import MeshError
from relight3d.io.meshes import check_mesh, read_mesh, write_mesh
from relight3d.records import TriangleMesh
from tests.shapes import ball, cube, grid, join


def corners_of(mesh):
    return mesh.vertices[mesh.faces]


def assert_same(got, wanted):
    """Bit for bit, and with the same attributes."""
    for name in ("vertices", "faces", "vertex_normals", "corner_uvs", "object_id"):
        one, other = getattr(got, name), getattr(wanted, name)
        assert (one is None) == (other is None), name
        if one is not None:
            assert one.dtype == other.dtype and np.array_equal(one, other), name
    assert (got.object_names or None) == (wanted.object_names or None)


# ------------------------------------------------------------------------------------------------ PLY


@pytest.mark.parametrize("seams", [False, True], ids=["one UV a vertex", "seams"])
def test_write_mesh_loses_nothing(tmp_path, seams):
    mesh, rng = ball(6, with_normals=True), np.random.default_rng(0)
    uvs = rng.random((len(mesh.faces), 3, 2)) if seams else rng.random((len(mesh.vertices), 2))[mesh.faces]
    full = TriangleMesh(
        mesh.vertices + 1e6,
        mesh.faces,
        mesh.vertex_normals,
        uvs.astype(np.float32),
        rng.integers(-1, 5, len(mesh.faces)).astype(np.int32),
        {-1: "none", 3: "a bronze mirror"},
    )
    write_mesh(tmp_path / "full.ply", full)
    assert_same(read_mesh(tmp_path / "full.ply"), full)
    bare = TriangleMesh(mesh.vertices, mesh.faces)
    write_mesh(tmp_path / "full.ply", bare)
    assert_same(read_mesh(tmp_path / "full.ply"), bare)
    assert [path.name for path in tmp_path.iterdir()] == ["full.ply"]  # nothing temporary stays


def ply_file(path, order, label_type, index_name="vertex_indices"):
    """A grid of quads with labels, written in one of the three byte orders."""
    numpy_type = {"uchar": "u1", "int": "i4", "uint": "u4", "float": "f4", "double": "f8"}[label_type]
    quads, labels = [[0, 1, 3, 2], [2, 3, 5, 4]], [7, 9]
    vertices = [[x, y, 0.5] for y in range(3) for x in range(2)]
    kind = {"<": "binary_little_endian", ">": "binary_big_endian", "": "ascii"}[order]
    header = (
        f"ply\nformat {kind} 1.0\nobj_info made by hand\nelement vertex 6\nproperty float x\nproperty float y\n"
        f"property float z\nelement face 2\nproperty {label_type} object_id\nproperty list uchar int {index_name}\n"
        "end_header\n"
    )
    if order:
        body = np.array(vertices, dtype=order + "f4").tobytes()
        for quad, label in zip(quads, labels):
            body += np.array(label, dtype=order + numpy_type).tobytes() + b"\4" + np.array(quad, order + "i4").tobytes()
    else:
        lines = [" ".join(map(str, row)) for row in vertices]
        lines += [f"{label} 4 " + " ".join(map(str, quad)) for quad, label in zip(quads, labels)]
        body = "\n".join(lines).encode()
    path.write_bytes(header.encode() + body)


@pytest.mark.parametrize("order", ["<", ">", ""], ids=["little", "big", "ascii"])
@pytest.mark.parametrize("label_type", ["uchar", "int", "uint", "float", "double"])
def test_ply_of_quads_with_labels(tmp_path, order, label_type):
    ply_file(tmp_path / "quads.ply", order, label_type, "vertex_index" if label_type == "int" else "vertex_indices")
    mesh = read_mesh(tmp_path / "quads.ply")
    assert mesh.faces.tolist() == [[0, 1, 3], [0, 3, 2], [2, 3, 5], [2, 5, 4]]
    assert mesh.object_id.tolist() == [7, 7, 9, 9] and mesh.object_id.dtype == np.int32
    assert mesh.vertices.dtype == np.float64 and mesh.vertices[5].tolist() == [1, 2, 0.5]
    assert mesh.vertex_normals is None and mesh.corner_uvs is None


@pytest.mark.parametrize("names", ["s t", "u v", "texture_u texture_v"])
def test_ply_vertex_uvs_by_any_of_their_names(tmp_path, names):
    u, v = names.split()
    (tmp_path / "uv.ply").write_text(
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
        f"property float {u}\nproperty float {v}\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
        "0 0 0 0 0.25\n1 0 0 1 0.25\n0 1 0 0 0.75\n3 0 1 2\n"
    )
    assert read_mesh(tmp_path / "uv.ply").corner_uvs.tolist() == [[[0, 0.25], [1, 0.25], [0, 0.75]]]


def test_single_nan_vertices_are_for_cleaning_to_judge(tmp_path):
    mesh = grid(3)
    mesh.vertices[5] = np.nan
    write_mesh(tmp_path / "nan.ply", mesh)
    assert np.isnan(read_mesh(tmp_path / "nan.ply").vertices[5]).all()


# ------------------------------------------------------------------------------------------------ OBJ

OBJ = """# a comment
mtllib nowhere.mtl
o table
v 0 0 0 0.5 0.5 0.5
v 1 0 0
v 1 1 0   # with a remark
v 0 1 0
vt 0 0
vt 1 0
vt 1 1
vt 0 1 0
vn 0 0 1
vn 0 1 0
usemtl dark wood
f 1/1/1 2/2/1 3/3/1 4/4/1
usemtl bronze
f 1/4/2 \\
  2/3/2 3/2/2
l 1 2
"""


def test_obj_with_everything(tmp_path):
    (tmp_path / "all.obj").write_text(OBJ)
    mesh = read_mesh(tmp_path / "all.obj")
    assert mesh.object_id.tolist() == [0, 0, 1]
    assert dict(mesh.object_names) == {0: "dark wood", 1: "bronze"}
    assert corners_of(mesh)[1].tolist() == [[0, 0, 0], [1, 1, 0], [0, 1, 0]]
    assert mesh.corner_uvs[1].tolist() == [[0, 0], [1, 1], [0, 1]]
    assert mesh.corner_uvs[2].tolist() == [[0, 1], [1, 1], [1, 0]]
    # Places 0 to 2 are used with both normals, so they are two vertices each.
    assert mesh.vertex_normals[mesh.faces][:2].tolist() == [[[0, 0, 1]] * 3] * 2
    assert mesh.vertex_normals[mesh.faces][2].tolist() == [[0, 1, 0]] * 3
    assert len(mesh.vertices) == 7


def test_obj_line_ends_of_windows(tmp_path):
    (tmp_path / "unix.obj").write_text(OBJ)
    (tmp_path / "dos.obj").write_bytes(OBJ.replace("\n", "\r\n").encode())
    assert_same(read_mesh(tmp_path / "dos.obj"), read_mesh(tmp_path / "unix.obj"))


@pytest.mark.parametrize(
    "faces, counted_back", [("f 1 2 3", "f -4 -3 -2"), ("f 1//1 2//1 3//1", "f -4//-1 -3//-1 -2//-1")]
)
def test_obj_indices_count_back_from_their_line(tmp_path, faces, counted_back):
    text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nvn 0 0 1\n{}\nv 9 9 9\nvn 1 0 0\n"
    (tmp_path / "one.obj").write_text(text.format(faces))
    (tmp_path / "other.obj").write_text(text.format(counted_back))
    assert_same(read_mesh(tmp_path / "other.obj"), read_mesh(tmp_path / "one.obj"))


def test_obj_without_materials_takes_objects_and_groups(tmp_path):
    text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\no lamp\nf 2 3 1\ng shade\nf 3 1 2\ng foot\nf 1 2 3\n"
    text += "o lamp\ng shade\nf 1 2 3\n"
    (tmp_path / "groups.obj").write_text(text)
    mesh = read_mesh(tmp_path / "groups.obj")
    assert mesh.object_id.tolist() == [0, 1, 2, 3, 2]
    assert dict(mesh.object_names) == {0: "unnamed", 1: "lamp", 2: "lamp / shade", 3: "lamp / foot"}
    assert mesh.vertices.shape == (3, 3)  # nothing split, nothing merged


def test_obj_corners_without_normal_or_uv_get_zeros(tmp_path):
    (tmp_path / "mixed.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0.5 0.5\nvn 0 0 2\nf 1/1/1 2//1 3\n")
    mesh = read_mesh(tmp_path / "mixed.obj")
    assert mesh.vertex_normals[mesh.faces][0].tolist() == [[0, 0, 2], [0, 0, 2], [0, 0, 0]]
    assert mesh.corner_uvs[0].tolist() == [[0.5, 0.5], [0, 0], [0, 0]]


# ------------------------------------------------------------------------------------------------ STL


def stl_bytes(mesh, header=b"solid but binary"):
    record = np.zeros(len(mesh.faces), dtype=[("n", "<f4", 3), ("p", "<f4", (3, 3)), ("a", "<u2")])
    record["p"] = corners_of(mesh)
    return header.ljust(80) + struct.pack("<I", len(mesh.faces)) + record.tobytes()


def ascii_stl(mesh, name):
    facets = [
        "facet normal 0 0 0\n outer loop\n"
        + "".join(f"  vertex {x} {y} {z}\n" for x, y, z in face)
        + " endloop\nendfacet\n"
        for face in corners_of(mesh).tolist()
    ]
    return f"solid {name}\n{''.join(facets)}endsolid {name}\n"


def test_stl_binary_and_ascii(tmp_path):
    mesh = cube(0.5)
    (tmp_path / "binary.stl").write_bytes(stl_bytes(mesh))
    (tmp_path / "ascii.STL").write_text(ascii_stl(mesh, "box"))
    for name in ("binary.stl", "ascii.STL"):
        read = read_mesh(tmp_path / name)
        assert (corners_of(read) == corners_of(mesh)).all() and read.object_id is None
        assert len(read.vertices) == 36  # unmerged


def test_stl_solids_are_labels(tmp_path):
    (tmp_path / "two.stl").write_text(ascii_stl(cube(), "box one") + ascii_stl(grid(1), ""))
    mesh = read_mesh(tmp_path / "two.stl")
    assert mesh.object_id.tolist() == [0] * 12 + [1] * 2
    assert dict(mesh.object_names) == {0: "box one", 1: "solid 1"}


# ----------------------------------------------------------------------------------------------- glTF


def gltf_parts(glb):
    """Two primitives with materials under a moved, turned, scaled node, and one under a mirroring node."""
    position = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], dtype="<f4")
    normal, uv = np.tile(np.array([0, 0, 1], "<f4"), (3, 1)), np.array([[0, 0], [1, 0], [0, 1]], "<f4")
    index = np.array([0, 1, 2, 0], dtype="<u2")  # padded to four bytes
    blob = position.tobytes() + normal.tobytes() + uv.tobytes() + index.tobytes()
    starts = np.cumsum([0, position.nbytes, normal.nbytes, uv.nbytes])
    kinds = [(5126, 3, "VEC3"), (5126, 3, "VEC3"), (5126, 3, "VEC2"), (5123, 3, "SCALAR")]
    lengths = [position.nbytes, normal.nbytes, uv.nbytes, 6]
    part = {"attributes": {"POSITION": 0, "NORMAL": 1, "TEXCOORD_0": 2}, "indices": 3}
    header = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0, 2]}],
        "nodes": [
            {"translation": [10, 0, 0], "children": [1]},
            {"mesh": 0, "rotation": [0, 0, 0.5**0.5, 0.5**0.5], "scale": [2, 2, 4]},
            {"mesh": 1, "scale": [-1, 1, 1]},
        ],
        "meshes": [
            {"name": "desk", "primitives": [{**part, "material": 0}, {**part, "material": 1}]},
            {"name": "board", "primitives": [{**part, "material": 0}]},
        ],
        "materials": [
            {"name": "wood", "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}},
            {"name": "bronze"},
        ],
        "textures": [{"source": 0}],
        "images": [{"uri": "not there.png"}],
        "bufferViews": [
            {"buffer": 0, "byteOffset": int(start), "byteLength": length} for start, length in zip(starts, lengths)
        ],
        "accessors": [
            {"bufferView": i, "componentType": kind, "count": count, "type": shape}
            for i, (kind, count, shape) in enumerate(kinds)
        ],
        "buffers": [{"byteLength": len(blob)}],
    }
    if not glb:
        header["buffers"][0]["uri"] = "data:application/octet-stream;base64," + base64.b64encode(blob).decode()
        return json.dumps(header).encode()
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(blob), 0x004E4942) + blob
    return struct.pack("<III", 0x46546C67, 2, 12 + len(chunks)) + chunks


@pytest.mark.parametrize("suffix", [".gltf", ".glb"])
def test_gltf_places_its_parts(tmp_path, suffix):
    path = tmp_path / f"scene{suffix}"
    path.write_bytes(gltf_parts(suffix == ".glb"))
    mesh = read_mesh(path)
    assert dict(mesh.object_names) == {0: "wood", 1: "bronze"}
    assert mesh.object_id.tolist() == [0, 1, 0]
    # Scaled, then turned by 90 degrees about z, then moved.
    assert corners_of(mesh)[0] == pytest.approx(np.array([[10, 0, 0], [10, 2, 0], [8, 0, 0]]), abs=1e-12)
    # Mirrored in x, and turned over so that it still faces up.
    assert corners_of(mesh)[2] == pytest.approx(np.array([[0, 0, 0], [0, 1, 0], [-1, 0, 0]]), abs=1e-12)
    assert mesh.vertex_normals == pytest.approx(np.tile([0, 0, 1], (9, 1)), abs=1e-6)
    assert mesh.corner_uvs[0].tolist() == [[0, 1], [1, 1], [0, 0]]  # v up
    assert mesh.corner_uvs[2].tolist() == [[0, 1], [0, 0], [1, 1]]


def test_gltf_normals_turn_by_the_inverse_transpose(tmp_path):
    header = json.loads(gltf_parts(False))
    header["nodes"][2] = {"mesh": 1, "matrix": [1, 0, 1, 0, 0, 1, 0, 0, 0, 0, 1, 0, 5, 6, 7, 1]}  # sheared: z += x
    (tmp_path / "sheared.gltf").write_text(json.dumps(header))
    mesh = read_mesh(tmp_path / "sheared.gltf")
    a, b, c = corners_of(mesh)[2]
    assert a == pytest.approx([5, 6, 7]) and b == pytest.approx([6, 6, 8])
    true = np.cross(b - a, c - a) / np.linalg.norm(np.cross(b - a, c - a))
    assert mesh.vertex_normals[mesh.faces[2]] == pytest.approx(np.tile(true, (3, 1)), abs=1e-6)


# --------------------------------------------------------------------------------------------- errors


def broken_files(folder):
    """Name and content of files that must be refused."""
    good = folder / "good.ply"
    write_mesh(good, join(cube(), grid(2)))
    ply, stl, glb = good.read_bytes(), stl_bytes(cube()), gltf_parts(True)
    nan = TriangleMesh(np.full((3, 3), np.nan), np.array([[0, 1, 2]], dtype=np.int32))
    write_mesh(folder / "nan.ply", nan)
    text = ascii_stl(cube(), "x")
    far = np.array([0, 1, 99], dtype="<u2").tobytes()
    return {
        "empty.ply": b"",
        "empty.obj": b"",
        "empty.stl": b"",
        "empty.glb": b"",
        "empty.gltf": b"",
        "noise.ply": bytes(range(256)) * 8,
        "noise.obj": bytes(range(256)) * 8,
        "noise.stl": bytes(range(256)) * 8,
        "noise.glb": bytes(range(256)) * 8,
        "picture.obj": b"\x89PNG\r\n\x1a\n",
        "short.ply": ply[:-100],
        "short header.ply": ply[:60],
        "short.stl": stl[:-20],
        "short ascii.stl": text[: len(text) // 2].encode(),
        "short.glb": glb[:-40],
        "all nan.ply": (folder / "nan.ply").read_bytes(),
        "huge.ply": ply.replace(b"element vertex 17", b"element vertex 4000000000000000000"),
        "negative.ply": ply.replace(b"element vertex 17", b"element vertex -3"),
        "no faces.ply": ply.split(b"element face")[0] + b"end_header\n" + bytes(17 * 24),
        "no positions.ply": ply.replace(b"property double x", b"property double q"),
        "index.ply": ply[:-16] + np.array([99], dtype="<i4").tobytes() + ply[-12:],
        "no faces.obj": b"v 0 0 0\n",
        "index.obj": b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n",
        "zero index.obj": b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 0 1 2\n",
        "uv index.obj": b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1/1 2/1 3/1\n",
        "back too far.obj": b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf -4 -2 -1\n",
        "word.obj": b"v 0 0 zero\nv 1 0 0\nv 0 1 0\nf 1 2 3\n",
        "two numbers.obj": b"v 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n",
        "index.glb": glb[:-8] + far + glb[-2:],
        "no scene.gltf": b'{"asset": {"version": "2.0"}}',
        "old.gltf": b'{"asset": {"version": "1.0"}}',
        "list.gltf": b"[]",
    }


@pytest.fixture(scope="module")
def broken(tmp_path_factory):
    folder = tmp_path_factory.mktemp("broken")
    for name, content in broken_files(folder).items():
        (folder / name).write_bytes(content)
    return folder


BROKEN = """empty.ply empty.obj empty.stl empty.glb empty.gltf noise.ply noise.obj noise.stl noise.glb picture.obj
short.ply short%header.ply short.stl short%ascii.stl short.glb all%nan.ply huge.ply negative.ply
no%faces.ply no%positions.ply index.ply no%faces.obj index.obj zero%index.obj uv%index.obj
back%too%far.obj word.obj two%numbers.obj index.glb no%scene.gltf old.gltf list.gltf"""


@pytest.mark.parametrize("name", [name.replace("%", " ") for name in BROKEN.split()])
def test_a_broken_file_is_one_clear_line(broken, name):
    with pytest.raises(MeshError) as caught:
        read_mesh(broken / name)
    line = str(caught.value)
    assert line.startswith(str(broken / name)) and "\n" not in line and ": got " in line and ", expected " in line


@pytest.mark.parametrize("name", ["missing.ply", "missing.obj", "missing.stl", "missing.glb"])
def test_a_missing_file_says_so(tmp_path, name):
    with pytest.raises(MeshError, match="No such file"):
        read_mesh(tmp_path / name)


def test_a_foreign_suffix_names_the_formats(tmp_path):
    with pytest.raises(MeshError, match=r"a \.fbx file, expected one of \.ply \.obj \.stl \.gltf \.glb"):
        read_mesh(tmp_path / "scene.fbx")
    with pytest.raises(MeshError, match=r"ends in \.ply"):
        write_mesh(tmp_path / "scene.obj", cube())


def test_a_place_that_cannot_be_written_says_so(tmp_path):
    (tmp_path / "taken.ply").mkdir()
    with pytest.raises(MeshError, match="a folder"):
        write_mesh(tmp_path / "taken.ply", cube())


def test_check_mesh_compares_lengths():
    attributes = {"object_id": np.zeros(5, np.int32), "vertex_normals": np.zeros((2, 3), np.float32)}
    lines = ["mesh object_id: got 5 entries, expected 12", "mesh vertex_normals: got 2 entries, expected 8"]
    for (name, array), line in zip(attributes.items(), lines):
        mesh = cube()
        object.__setattr__(mesh, name, array)  # past the shape checks of the tests, which users do not have
        with pytest.raises(MeshError, match=line):
            check_mesh(mesh, "mesh")


@pytest.mark.parametrize("suffix", [".ply", ".obj", ".stl", ".gltf", ".glb"])
def test_flipped_bytes_never_crash_a_reader(tmp_path, suffix):
    whole = {
        ".obj": lambda: OBJ.encode(),
        ".stl": lambda: stl_bytes(cube()),
        ".gltf": lambda: gltf_parts(False),
        ".glb": lambda: gltf_parts(True),
    }
    if suffix == ".ply":
        write_mesh(tmp_path / "good.ply", join(cube(), grid(2)))
    good = (tmp_path / "good.ply").read_bytes() if suffix == ".ply" else whole[suffix]()
    path, rng, refused = tmp_path / f"bad{suffix}", np.random.default_rng(1), 0
    for _ in range(150):
        data = bytearray(good)
        for at in rng.integers(0, len(data), 3):
            data[at] = rng.integers(0, 256)
        path.write_bytes(bytes(data[: rng.integers(len(data) // 2, len(data) + 1)] if rng.random() < 0.3 else data))
        try:
            read_mesh(path)
        except MeshError as error:
            refused += 1
            assert "\n" not in str(error)
    assert refused > 0
