"""The objects: built in code, loaded from files, and reduced."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image
from scipy.spatial import KDTree
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

from server.sim.meshes import ObjectModel, SceneError
from server.sim.scenes.catalogue import SCENES, load_object
from server.sim.scenes.light import floor_shadow, lit_colours
from server.sim.scenes.loading import MAX_TRIANGLES
from server.sim.scenes.reduction import reduced
from server.sim.scenes.surfaces import Grid, Noise

SIZES_M = {
    "human": (0.36, 0.92, 1.65),
    "guitar": (0.45, 0.38, 1.0),
    "robot_dog": (0.66, 0.31, 0.42),
    "recycle_bin": (0.53, 0.51, 0.75),
}


@pytest.mark.parametrize("name", SCENES)
def test_scene_stands_on_the_floor_in_its_size(name):
    model = load_object(name)
    lower, upper = model.vertices.min(axis=0), model.vertices.max(axis=0)
    np.testing.assert_allclose(lower[:2], -upper[:2], atol=1e-9)
    assert lower[2] == pytest.approx(0.0, abs=1e-9)
    np.testing.assert_allclose(model.size_m, SIZES_M[name], atol=0.035)
    assert 5_000 <= len(model.faces) <= 80_000


@pytest.mark.parametrize("name", SCENES)
def test_scene_is_asymmetric_and_patterned(name):
    """A mirrored or turned object must not pass for itself: poses would be ambiguous."""
    model = load_object(name)
    points, index, *_ = trimesh.sample.sample_surface(model.trimesh, 4000, seed=1)
    colours = model.colours[model.faces[index, 0]].astype(float)
    tree = KDTree(points)
    for change in ([-1, 1, 1], [1, -1, 1], [-1, -1, 1]):
        distance, nearest = tree.query(points * change)
        differs = (distance > 0.02) | (np.abs(colours[nearest] - colours).max(axis=1) > 40)
        assert differs.mean() > 0.1
    assert np.unique(model.colours // 16, axis=0).shape[0] > 40


@pytest.mark.parametrize("name", SCENES)
def test_triangles_are_fine(name):
    corners = load_object(name).vertices[load_object(name).faces]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    assert np.percentile(longest, 95) < 0.06


def test_unknown_scene_lists_the_known_ones():
    with pytest.raises(SceneError) as caught:
        load_object("teapot")
    for name in ("teapot", *SCENES):
        assert name in str(caught.value)
    assert "\n" not in str(caught.value)


def obj_text(*lines: str) -> str:
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize(
    ("file", "content", "says"),
    [
        ("missing.glb", None, "no such file"),
        ("shape.stl", "solid x\nendsolid x\n", "not a .glb or .obj"),
        ("broken.glb", "glTF but not really", "cannot be read"),
        ("empty.glb", "", "cannot be read"),
        ("faceless.obj", obj_text("v 0 0 0", "v 1 0 0", "v 0 1 0"), "no triangles"),
        ("nan.obj", obj_text("v nan 0 0", "v 1 0 0", "v 0 1 0", "f 1 2 3"), "not finite"),
        ("inf.obj", obj_text("v 0 inf 0", "v 1 0 0", "v 0 1 0", "f 1 2 3"), "not finite"),
        ("point.obj", obj_text("v 0 0 0", "v 0 0 0", "v 0 0 0", "f 1 2 3"), "one point"),
    ],
)
def test_bad_files_get_one_clear_line(tmp_path, file, content, says):
    path = tmp_path / file
    if content is not None:
        path.write_text(content)
    with pytest.raises(SceneError, match=says) as caught:
        load_object(str(path))
    assert "\n" not in str(caught.value)
    assert file in str(caught.value)


def test_truncated_glb_is_refused(tmp_path):
    whole = trimesh.creation.box((0.5, 0.5, 0.5)).export(file_type="glb")
    assert isinstance(whole, bytes)
    for share in (0.2, 0.6, 0.95):
        path = tmp_path / "cut.glb"
        path.write_bytes(whole[: int(len(whole) * share)])
        with pytest.raises(SceneError, match=r"cut\.glb"):
            load_object(str(path))


def test_y_up_file_stands_upright(tmp_path):
    """An L in the file's x-y plane, tall in y: here tall in z, its foot still towards +x."""
    post = trimesh.creation.box((0.1, 1.2, 0.2))
    foot = trimesh.creation.box((0.4, 0.1, 0.2))
    foot.apply_translation((0.25, -0.55, 0.0))
    trimesh.util.concatenate([post, foot]).export(tmp_path / "l.glb")
    model = load_object(str(tmp_path / "l.glb"))
    np.testing.assert_allclose(model.size_m, (0.5, 0.2, 1.2), atol=1e-6)
    assert model.vertices[:, 2].min() == pytest.approx(0.0, abs=1e-9)
    top = model.vertices[model.vertices[:, 2] > 1.1]
    assert top[:, 0].max() < 0.0


@pytest.mark.parametrize("edge_m", [0.03, 7.0])
def test_absurd_sizes_become_one_metre(tmp_path, edge_m, caplog):
    trimesh.creation.box((edge_m, edge_m / 2, edge_m / 4)).export(tmp_path / "b.glb")
    model = load_object(str(tmp_path / "b.glb"))
    assert model.size_m.max() == pytest.approx(1.0)
    assert "scaled to 1 m" in caplog.text


def test_textures_and_plain_colours_share_one_picture(tmp_path):
    """A half red, half blue picture on one part and a plain green part keep their colours."""
    picture = np.zeros((64, 64, 3), np.uint8)
    picture[:, :32] = (220, 10, 10)
    picture[:, 32:] = (10, 10, 220)
    flat = trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]])
    uv = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], float)
    material = PBRMaterial(baseColorTexture=Image.fromarray(picture))
    flat.visual = TextureVisuals(uv=uv, material=material)
    other = trimesh.creation.box((0.2, 0.2, 0.2))
    other.apply_translation((1.5, 0.1, 0.0))
    green = PBRMaterial(baseColorFactor=[0, 255, 0, 255])
    other.visual = TextureVisuals(uv=np.zeros((len(other.vertices), 2)), material=green)
    trimesh.Scene([flat, other]).export(tmp_path / "two.glb")
    model = load_object(str(tmp_path / "two.glb"))
    assert model.uv is not None
    assert model.texture is not None
    size = np.array(model.texture.shape[1::-1])
    middles = model.uv[model.faces].mean(axis=1)
    texel = np.clip(
        (np.stack([middles[:, 0], 1 - middles[:, 1]], 1) * size).astype(int), 0, size - 1
    )
    tint = model.colours[model.faces].mean(axis=1) / 255.0
    seen = model.texture[texel[:, 1], texel[:, 0], :3] * tint
    x = model.vertices[model.faces].mean(axis=1)[:, 0] - model.vertices[:, 0].min()
    for low, high, rgb in (
        (0.05, 0.45, (220, 10, 10)),
        (0.55, 0.95, (10, 10, 220)),
        (1.3, 1.7, (0, 255, 0)),
    ):
        where = (x > low) & (x < high)
        assert where.sum() >= 4
        np.testing.assert_allclose(seen[where], np.tile(rgb, (where.sum(), 1)), atol=3)


@settings(max_examples=15, deadline=None)
@given(limit=st.integers(150, 4000), seed=st.integers(0, 1000))
def test_reduction_keeps_the_shape(limit, seed):
    """A bumpy ball with shuffled winding stays a bumpy ball, its colours in place."""
    rng = np.random.default_rng(seed)
    ball = trimesh.creation.icosphere(4, 0.5)
    vertices = ball.vertices * (1 + 0.1 * np.sin(7 * ball.vertices[:, :1]))
    faces = np.array([rng.permutation(f) for f in ball.faces])
    v, f, a = reduced(vertices, faces, vertices.copy(), limit)
    assert 0.2 * limit < len(f) <= limit
    assert f.max() < len(v) == len(a)
    cell_m = 2.2 * np.sqrt(np.pi / limit)
    # The carried attribute is the place itself, so it must arrive near its vertex.
    assert np.abs(a - v).max() < 2 * cell_m
    radius = np.linalg.norm(v, axis=1) / (1 + 0.1 * np.sin(7 * v[:, 0]))
    np.testing.assert_allclose(radius, 0.5, atol=0.25 * cell_m + 0.01)


def test_reduction_leaves_small_meshes_alone():
    ball = trimesh.creation.icosphere(2)
    v, f, _ = reduced(ball.vertices, ball.faces, ball.vertices, len(ball.faces))
    assert v is ball.vertices
    assert f is ball.faces


def test_light_does_not_trust_the_winding():
    ball = trimesh.creation.icosphere(4, 0.4)
    vertices = ball.vertices + np.array([0, 0, 0.4])
    white = np.full((len(vertices), 3), 255, np.uint8)
    right = lit_colours(ObjectModel(vertices, ball.faces, white))
    wrong = lit_colours(ObjectModel(vertices, ball.faces[:, ::-1], white))
    assert np.abs(right.astype(int) - wrong).max() <= 2
    top, bottom = right[vertices[:, 2] > 0.7].mean(), right[vertices[:, 2] < 0.1].mean()
    assert top > bottom + 20


def test_the_shadow_lies_under_the_object():
    model = load_object("robot_dog")
    shadow = floor_shadow(model, 6.6, 0)
    assert shadow.min() > 0.0
    assert shadow.max() <= 1.0
    middle = shadow[374:394, 374:394].mean()
    assert middle < 0.9
    assert shadow[:40].mean() > 0.995


@given(st.floats(-20, 20), st.floats(-20, 20), st.floats(0.02, 2.0))
@settings(max_examples=25, deadline=None)
def test_noise_depends_on_the_place_alone(x, y, cell):
    """Two tiles that overlap must agree, so that neighbours fit together."""
    noise = Noise(3)
    wide = noise.field(Grid(x, y, 1.0, 1.0, 101, 101), 5, cell)
    part = noise.field(Grid(x + 20 / 101, y + 30 / 101, 51 / 101, 41 / 101, 51, 41), 5, cell)
    np.testing.assert_allclose(part, wide[30:71, 20:71], atol=2e-3)


DATA = os.environ.get("DRONERF_TEST_DATA")


@pytest.mark.slow
@pytest.mark.skipif(DATA is None, reason="DRONERF_TEST_DATA is not set")
@pytest.mark.parametrize(
    "name", ["human", "guitar", "robot_dog", "office_chair", "flight_helmet", "spot_cow"]
)
def test_real_meshes_load_and_keep_their_surface(name):
    path = Path(str(DATA)) / "meshes" / f"{name}.glb"
    model = load_object(str(path))
    assert len(model.faces) <= MAX_TRIANGLES
    whole = trimesh.load_scene(path).to_mesh()
    np.testing.assert_allclose(np.sort(model.size_m), np.sort(whole.extents), atol=0.012)
    original = whole.vertices[np.unique(whole.faces)] @ np.array(
        [[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]
    )
    original = (
        original
        - (original.min(0) + original.max(0)) * [0.5, 0.5, 0]
        - [0, 0, original[:, 2].min()]
    )
    points = trimesh.sample.sample_surface(model.trimesh, 80_000, seed=0)[0]
    gap = KDTree(points).query(original)[0]
    assert np.percentile(gap, 95) < 0.015
