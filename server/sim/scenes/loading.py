"""Loading an object of the simulated room from a glTF binary or OBJ file.

The file's materials become one texture picture (an atlas) and one colour per vertex, which the
renderer multiplies. Texture coordinates are OpenGL's: v grows upwards.

Symbols: ``n`` vertices, ``m`` triangles.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import trimesh
from numpy.typing import NDArray
from PIL import Image
from trimesh.visual import ColorVisuals

from server.sim.meshes import ObjectModel, SceneError, on_floor
from server.sim.scenes.reduction import reduced

Array = NDArray[np.float64]
Bytes = NDArray[np.uint8]

log = logging.getLogger(__name__)

SUFFIXES = (".glb", ".obj")
MAX_TRIANGLES = 16_000
_SIZE_RANGE_M = (0.1, 2.0)
_ATLAS_PX = 2048
_EDGE_M = 0.03
# glTF and OBJ are Y up; the world is Z up: a quarter turn about x.
_R_WORLD_FILE = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])


@dataclass(frozen=True, eq=False)
class _Part:
    """One mesh of a file; its look is colours (RGB, 0 to 255) times picture (RGBA uint8)."""

    vertices: Array
    faces: NDArray[np.int64]
    colours: Array
    uv: Array
    picture: Bytes


def load_mesh(path: Path) -> ObjectModel:
    """Load a glTF binary or OBJ file as an object of the simulated room.

    Y-up metres are assumed. Finer meshes are reduced to at most ``MAX_TRIANGLES``; an object whose
    largest side lies outside 0.1 to 2 m is scaled to 1 m.

    Raises:
        SceneError: If the file is missing, of another kind, unreadable, without triangles or not
            finite.
    """
    parts = _read(path)
    uvs, atlas = _atlas(parts)
    starts = np.cumsum([0] + [len(p.vertices) for p in parts[:-1]])
    faces = np.concatenate([p.faces + start for p, start in zip(parts, starts, strict=True)])
    vertices = _sized(np.concatenate([p.vertices for p in parts]) @ _R_WORLD_FILE.T, faces, path)
    colours = np.concatenate([p.colours for p in parts])
    attributes = np.concatenate([np.concatenate(uvs), colours], axis=1)
    vertices, faces, attributes = _tessellated(vertices, faces, attributes)
    before = len(faces)
    vertices, faces, attributes = reduced(vertices, faces, attributes, MAX_TRIANGLES)
    if len(faces) < before:
        log.info("%s reduced from %d to %d triangles", path.name, before, len(faces))
    tint = np.clip(np.rint(attributes[:, 2:]), 0, 255).astype(np.uint8)
    return ObjectModel(on_floor(vertices), faces, tint, attributes[:, :2], atlas, name=path.stem)


def _read(path: Path) -> list[_Part]:
    """Return the parts of a file that have triangles."""
    if path.suffix.lower() not in SUFFIXES:
        raise SceneError(f"{path}: not a {' or '.join(SUFFIXES)} file")
    if not path.is_file():
        raise SceneError(f"{path}: no such file")
    try:
        scene = trimesh.load_scene(path, process=False)
        meshes = [g for g in scene.dump() if isinstance(g, trimesh.Trimesh) and len(g.faces)]
        parts = [_part(mesh) for mesh in meshes]
    # Broken files fail in the parsers in any way there is; to the operator they all mean the same.
    except Exception as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise SceneError(f"{path}: cannot be read ({reason})") from error
    if not parts:
        raise SceneError(f"{path}: contains no triangles")
    if not all(np.isfinite(part.vertices).all() for part in parts):
        raise SceneError(f"{path}: contains vertices that are not finite numbers")
    return parts


def _sized(vertices: Array, faces: NDArray[np.int64], path: Path) -> Array:
    """Return ``vertices``, scaled to 1 m when the object is absurdly small or large."""
    largest_m = float(np.ptp(vertices[np.unique(faces)], axis=0).max())
    if largest_m < 1e-9:
        raise SceneError(f"{path}: all triangles are one point")
    if _SIZE_RANGE_M[0] <= largest_m <= _SIZE_RANGE_M[1]:
        return vertices
    log.warning("%s is %.3g m large, scaled to 1 m", path.name, largest_m)
    return vertices / largest_m


def _tessellated(
    vertices: Array, faces: NDArray[np.int64], attributes: Array
) -> tuple[Array, NDArray[np.int64], Array]:
    """Return the mesh with its triangles quartered while that leaves few enough and edges are long.

    The renderer draws large triangles inexactly, and light is known at vertices only.
    """
    while 4 * len(faces) <= MAX_TRIANGLES:
        corners = vertices[faces]
        lengths = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
        if lengths.max() <= _EDGE_M:
            break
        # Edges in the order ab, bc, ca; both triangles at an edge share its middle.
        ends = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2), axis=2).reshape(-1, 2)
        edges, middle = np.unique(ends, axis=0, return_inverse=True)
        ab, bc, ca = (len(vertices) + middle.reshape(-1, 3)).T
        a, b, c = faces.T
        quarters = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
        faces = np.concatenate([np.stack(quarter, axis=1) for quarter in quarters])
        vertices = np.concatenate([vertices, vertices[edges].mean(axis=1)])
        attributes = np.concatenate([attributes, attributes[edges].mean(axis=1)])
    return vertices, faces, attributes


def _srgb_from_linear(linear: Array) -> Array:
    """Return sRGB of linear light, both in [0, 1]: glTF's factors are linear."""
    linear = np.clip(linear, 0.0, 1.0)
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


def _part(mesh: trimesh.Trimesh) -> _Part:
    """Return one mesh with its look as colours times picture."""
    n = len(mesh.vertices)
    visual = mesh.visual
    material = getattr(visual, "material", None)
    factor = getattr(material, "baseColorFactor", None)
    uv = getattr(visual, "uv", None)
    image = getattr(material, "baseColorTexture", None) or getattr(material, "image", None)
    picture = image if isinstance(image, Image.Image) and uv is not None and len(uv) == n else None
    if isinstance(visual, ColorVisuals) and visual.kind == "vertex":
        colours = np.asarray(visual.vertex_colors, float)[:, :3]
    elif factor is not None:
        # sRGB(light * factor) is nearly sRGB(light) * sRGB(factor), the curve being nearly a power.
        srgb = 255.0 * _srgb_from_linear(np.asarray(factor, float)[:3] / 255.0)
        colours = np.tile(srgb, (n, 1))
    elif picture is not None or material is None:
        colours = np.full((n, 3), 170.0 if picture is None else 255.0)
    else:
        colours = np.tile(np.asarray(material.main_color, float)[:3], (n, 1))
    texels = np.full((8, 8, 4), 255, np.uint8)
    coordinates = np.full((n, 2), 0.5)
    if picture is not None:
        texels, coordinates = _unrolled(np.asarray(picture.convert("RGBA")), np.asarray(uv, float))
        if getattr(material, "alphaMode", None) in (None, "OPAQUE"):
            texels[..., 3] = 255
    faces = np.asarray(mesh.faces, np.int64)
    return _Part(np.asarray(mesh.vertices, float), faces, colours, coordinates, texels)


def _unrolled(picture: Bytes, uv: Array) -> tuple[Bytes, Array]:
    """Return a picture that need not repeat, and coordinates in [0, 1] for it.

    A cell of an atlas cannot repeat, so a picture used up to four times per axis is laid out so
    often; beyond that the coordinates are wrapped, which smears the triangles that cross a border.
    """
    uv = np.nan_to_num(uv)
    slack = 1e-3
    uv = uv - np.floor(uv.min(axis=0) + slack)
    turns = np.maximum(1, np.ceil(uv.max(axis=0) - slack)).astype(int)
    if (turns > 4).any():
        return picture.copy(), np.mod(uv, 1.0)
    return np.tile(picture, (turns[1], turns[0], 1)), np.clip(uv / turns, 0.0, 1.0)


def _atlas(parts: list[_Part]) -> tuple[list[Array], Bytes]:
    """Lay the parts' pictures out on a square grid of cells of one size.

    Returns:
        Coordinates ``(n, 2)`` per part in the atlas, and the atlas, RGBA, its sides powers of two.
    """
    side = int(np.ceil(np.sqrt(len(parts))))
    # A power of two of cells per side keeps the mipmaps of neighbours apart for longest.
    side = 1 << (side - 1).bit_length()
    largest = max(max(p.picture.shape[:2]) for p in parts)
    cell = int(np.clip(1 << (largest - 1).bit_length(), 8, _ATLAS_PX // side))
    atlas = np.zeros((cell * side, cell * side, 4), np.uint8)
    margin = 1.5 / cell
    uvs = []
    for i, part in enumerate(parts):
        row, column = divmod(i, side)
        resized = cv2.resize(part.picture, (cell, cell), interpolation=cv2.INTER_AREA)
        atlas[row * cell : (row + 1) * cell, column * cell : (column + 1) * cell] = resized
        inner = margin + part.uv * (1.0 - 2.0 * margin)
        uvs.append((inner + np.array([column, side - 1 - row])) / side)
    return uvs, atlas
