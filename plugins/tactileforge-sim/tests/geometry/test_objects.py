import sys
import zipfile

import numpy as np
import pytest
import trimesh
from PIL import Image
from tactileforge_sim.geometry import mesh_files
from tactileforge_sim.geometry.indenter_geometry import DEEP, REACH
from tactileforge_sim.geometry.objects import cloud_shape, mesh_shape, picture_shape

from tactileforge.errors import ConfigError, DataError, DataNotFoundError

X = np.linspace(-3.5, 3.5, 29)
ZERO = np.zeros_like(X)


def _sphere(radius=5.0):
    return trimesh.creation.icosphere(subdivisions=5, radius=radius)


def _cloud(count, radius=5.0):
    points = np.random.default_rng(0).normal(size=(count, 3))
    return radius * points / np.linalg.norm(points, axis=1, keepdims=True)


def test_a_mesh_of_a_sphere_is_a_sphere():
    ball = mesh_shape(_sphere(), name="globe")
    expected = 5 - np.sqrt(25 - X**2)
    np.testing.assert_allclose(ball.height(X, ZERO), expected, atol=0.01)
    np.testing.assert_allclose(ball.height(ZERO, X), expected, atol=0.01)
    assert ball.name == "globe"
    assert ball.radius == pytest.approx(5.0, abs=0.2)
    assert ball.height(np.array([5.2]), np.array([0.0])) == DEEP


def test_only_the_upper_side_touches():
    # A cone on its base has its tip up; on its tip, its flat base.
    cone = trimesh.creation.cone(radius=5, height=6, sections=128)
    up = mesh_shape(cone).height(X, ZERO)
    np.testing.assert_allclose(up, np.minimum(np.abs(X) * 6 / 5, DEEP), atol=0.06)
    cone.vertices[:, 2] *= -1
    np.testing.assert_allclose(mesh_shape(cone).height(X, ZERO), 0, atol=1e-9)


def test_a_mesh_is_seen_from_above_not_mirrored():
    wedge = trimesh.creation.box((6, 6, 2))
    wedge.vertices[:, 2] += 0.1 * wedge.vertices[:, 0] + 0.2 * wedge.vertices[:, 1]
    high = mesh_shape(wedge).height(np.array([2.0, -2, 0, 0]), np.array([0.0, 0, -2, 2]))
    # Highest at the corner right (x = 3) and up (y = 3, which is up in the picture).
    np.testing.assert_allclose(high, [0.7, 1.1, 0.5, 1.3], atol=0.03)


def test_a_finer_mesh_of_the_same_object_gives_the_same_heights():
    box = trimesh.creation.box((7, 4, 3))
    turn = trimesh.transformations.rotation_matrix(0.5, (1, 1, 0.3))
    box.apply_transform(turn)
    fine = box.subdivide().subdivide().subdivide().subdivide()
    axis = np.linspace(-5, 5, 60)
    x, y = np.meshgrid(axis, axis)
    np.testing.assert_allclose(
        mesh_shape(box).height(x, y), mesh_shape(fine).height(x, y), atol=1e-6
    )


def test_a_file_in_metres(tmp_path):
    path = tmp_path / "pebble.stl"
    _sphere(0.005).export(path)
    pebble = mesh_shape(path, mm_per_unit=1000)
    assert pebble.name == "pebble"
    np.testing.assert_allclose(pebble.height(X, ZERO), 5 - np.sqrt(25 - X**2), atol=0.01)


def test_a_scene_of_two_meshes(tmp_path):
    scene = trimesh.Scene([_sphere(1.5), _sphere(1.5).apply_translation((6, 0, 0))])
    path = tmp_path / "pair.glb"
    scene.export(path)
    pair = mesh_shape(path)
    heights = pair.height(np.array([-3.0, 0, 3]), np.zeros(3))
    np.testing.assert_allclose(heights, [0, DEEP, 0], atol=0.02)


def test_another_place_of_a_large_object_is_touched():
    beam = trimesh.creation.box((100, 8, 2))
    middle = mesh_shape(beam)
    assert middle.radius == pytest.approx(REACH, abs=0.2)
    end = mesh_shape(beam, at=(48, 0))
    np.testing.assert_allclose(end.height(np.array([-6.0, 1.9, 2.2]), np.zeros(3)), [0, 0, DEEP])
    with pytest.raises(ConfigError, match="nothing within 12 mm"):
        mesh_shape(beam, at=(80, 0))


def test_a_cloud_of_a_sphere_is_a_sphere():
    ball = cloud_shape(_cloud(20_000))
    expected = 5 - np.sqrt(25 - X**2)
    np.testing.assert_allclose(ball.height(X, ZERO), expected, atol=0.2)
    below = ball.height(X, ZERO) - expected  # points lie on the sphere, and none above it
    assert 0.015 < below.mean() < 0.05
    rim = ball.height(np.array([4.9, 5.1]), np.zeros(2))
    assert rim[0] < DEEP == rim[1]


def test_clouds_from_files(tmp_path):
    points = _cloud(5000)
    np.save(tmp_path / "scan.npy", points)
    trimesh.PointCloud(points).export(tmp_path / "scan.ply")
    first, other = (cloud_shape(tmp_path / f"scan.{kind}") for kind in ("npy", "ply"))
    assert first.name == other.name == "scan"
    np.testing.assert_allclose(first.height(X, ZERO), other.height(X, ZERO), atol=1e-3)


@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
def test_a_picture_of_heights(tmp_path, kind):
    ramp = np.tile(np.linspace(0, np.iinfo(kind).max, 81).round().astype(kind), (61, 1))
    Image.fromarray(ramp).save(tmp_path / "ramp.png")
    known = picture_shape(tmp_path / "ramp.png", mm_per_pixel=0.1, range_mm=2.0)
    heights = known.height(np.array([4.0, 0, -4, 4.3]), np.zeros(4))
    np.testing.assert_allclose(heights, [0, 1, 2, DEEP], atol=0.01)
    assert known.name == "ramp"


@pytest.mark.parametrize(
    ("points", "says"),
    [
        (np.zeros((0, 3)), r"shape \(0, 3\); give \(N, 3\)"),
        (np.zeros((50, 2)), r"shape \(50, 2\)"),
        (np.full((50, 3), np.nan), "50 of 50 points are not finite"),
        (np.full((50, 3), "a"), "not finite numbers"),
    ],
)
def test_clouds_that_are_none(points, says):
    with pytest.raises(DataError, match=says):
        cloud_shape(points)


def test_a_cloud_of_too_few_points_says_how_many():
    with pytest.raises(ConfigError, match=r"100 points over .* leave gaps of 6\.\d+ mm"):
        cloud_shape(_cloud(100))


def test_meshes_that_are_none(tmp_path):
    empty = trimesh.Trimesh()
    with pytest.raises(DataError, match="no faces"):
        mesh_shape(empty)
    broken = _sphere()
    broken.vertices[7] = np.nan
    with pytest.raises(DataError, match="globe: 1 of 10242 points are not finite"):
        mesh_shape(broken, name="globe")
    wrong = trimesh.Trimesh([[0, 0, 0], [4, 0, 0], [0, 4, 0]], [[0, 1, 9]], process=False)
    with pytest.raises(DataError, match="a vertex beyond the 3"):
        mesh_shape(wrong)
    (tmp_path / "notes.stl").write_text("hello")
    with pytest.raises(DataError, match=r"notes\.stl: the file holds no points"):
        mesh_shape(tmp_path / "notes.stl")
    (tmp_path / "notes.txt").write_text("hello")
    with pytest.raises(DataError, match=r"notes\.txt: not a mesh"):
        mesh_shape(tmp_path / "notes.txt")
    (tmp_path / "notes.npy").write_text("hello")
    with pytest.raises(DataError, match="not an array of numbers"):
        cloud_shape(tmp_path / "notes.npy")


def test_a_mesh_finer_than_the_grid_says_the_limit():
    with pytest.raises(ConfigError, match=r"0.01 mm wide.*4 cells of 0.05 mm = 0.2 mm.*metres"):
        mesh_shape(_sphere(0.005))
    with pytest.raises(ConfigError, match="spacing_mm 0: both must be above 0"):
        mesh_shape(_sphere(), spacing_mm=0)


@pytest.mark.parametrize("reader", [mesh_shape, cloud_shape])
def test_a_file_that_is_absent(tmp_path, reader):
    with pytest.raises(DataNotFoundError, match=r"none\.ply: no such file"):
        reader(tmp_path / "none.ply")


def test_without_trimesh_the_extra_is_named(tmp_path, monkeypatch):
    path = tmp_path / "ball.stl"
    _sphere().export(path)
    monkeypatch.setitem(sys.modules, "trimesh", None)
    with pytest.raises(ConfigError, match=r"pip install trimesh"):
        mesh_shape(path)


def test_pictures_that_are_none(tmp_path):
    path = tmp_path / "colour.png"
    Image.fromarray(np.zeros((20, 20, 3), np.uint8)).save(path)
    with pytest.raises(DataError, match="mode RGB; save it as grey"):
        picture_shape(path, 0.1, 1)
    Image.fromarray(np.zeros((2, 20), np.uint8)).save(path)
    with pytest.raises(ConfigError, match="20 x 2 pixels; the limit is 4"):
        picture_shape(path, 0.1, 1)
    with pytest.raises(ConfigError, match="mm_per_pixel is 0"):
        picture_shape(path, 0, 1)
    path.write_bytes(b"no picture")
    with pytest.raises(DataError, match="not a readable image"):
        picture_shape(path, 0.1, 1)
    noise = np.random.default_rng(0).integers(0, 255, (90, 90), dtype=np.uint8)
    Image.fromarray(noise).save(path)
    path.write_bytes(path.read_bytes()[:3000])
    with pytest.raises(DataError, match="not a readable image"):
        picture_shape(path, 0.1, 1)


def test_a_mesh_of_too_many_bytes_is_refused_before_it_is_read(tmp_path, monkeypatch):
    path = tmp_path / "ball.stl"
    _sphere().export(path)
    monkeypatch.setattr(mesh_files, "MAX_BYTES", path.stat().st_size - 1)
    monkeypatch.setattr(trimesh, "load", None)  # a call would be a TypeError
    with pytest.raises(DataError, match=r"ball\.stl: a mesh of 1\.0 MB, where 1\.0 MB"):
        mesh_shape(path)


@pytest.mark.slow
def test_an_archive_counts_as_what_it_unpacks_to(tmp_path):
    """600 MB of zeros in 600 kB; 3MF is such an archive."""
    path = tmp_path / "bomb.3mf"
    with (
        zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive,
        archive.open("3D/3dmodel.model", "w") as member,
    ):
        for _ in range(600):
            member.write(bytes(1_000_000))
    assert path.stat().st_size < 1_000_000
    with pytest.raises(DataError, match=r"bomb\.3mf: a mesh of 600\.6 MB"):
        mesh_shape(path)


def test_too_many_faces_and_points_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(mesh_files, "MAX_PARTS", 20_479)
    with pytest.raises(DataError, match="globe: 20,480 faces, where 20,479 are the limit"):
        mesh_shape(_sphere(), name="globe")
    monkeypatch.setattr(mesh_files, "MAX_PARTS", 999)
    with pytest.raises(DataError, match="cloud: 1,000 points"):
        cloud_shape(_cloud(1000))


def test_a_header_that_states_more_points_than_the_file_has_is_refused(tmp_path):
    path = tmp_path / "scan.npy"
    np.save(path, _cloud(9))
    raw = path.read_bytes()
    for count in (b"(10, 3)", b"(10**9", b"(999999999999, 3)", b"(9999999999999999999999, 3)"):
        lie = raw.replace(b"(9, 3), }" + b" " * len(count), count + b", }" + b" " * 8)
        assert lie != raw
        path.write_bytes(lie)
        with pytest.raises(DataError, match=r"scan\.npy: not an array of numbers"):
            cloud_shape(path)


@pytest.mark.parametrize("faces", [10**7, 10**12])
def test_a_mesh_whose_header_lies_is_refused(tmp_path, faces):
    path = tmp_path / "lie.ply"
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex {faces}\nproperty float x\n"
    path.write_bytes(f"{head}property float y\nproperty float z\nend_header\n".encode())
    with pytest.raises(DataError, match=r"lie\.ply: not a mesh"):
        mesh_shape(path)
