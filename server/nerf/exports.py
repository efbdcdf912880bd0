"""What other programs open: meshes (GLB, PLY), points (PLY), COLMAP models.

World axes are those of the flight: metres, +Z up. GLB turns them to +Y up, as its standard wants.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pycolmap
import trimesh
from numpy.typing import NDArray

from server.drafts import drafted
from server.geometry.poses import inverse
from server.nerf.dataset import Dataset
from server.nerf.surface import Surface

Array = NDArray[np.float64]

# +Z up to +Y up.
_TO_GLB = np.array([[1.0, 0, 0, 0], [0, 0, 1.0, 0], [0, -1.0, 0, 0], [0, 0, 0, 1.0]])


def write_mesh(surface: Surface, file: Path) -> None:
    """Write triangles with coloured corners as GLB or PLY, by the file's ending."""
    mesh = trimesh.Trimesh(
        surface.vertices,
        surface.faces,
        vertex_normals=surface.normals,
        vertex_colors=surface.colours,
        process=False,
    )
    if file.suffix == ".glb":
        mesh.apply_transform(_TO_GLB)
    _write(file, lambda draft: mesh.export(draft, file_type=file.suffix[1:]))


def write_points(points: Array, colours: NDArray[np.uint8], file: Path) -> None:
    """Write coloured points ``(n, 3)``, world metres, as PLY."""
    cloud = trimesh.PointCloud(points, colours)
    _write(file, lambda draft: cloud.export(draft, file_type="ply"))


def write_colmap(dataset: Dataset, points: Array, colours: NDArray[np.uint8], folder: Path) -> None:
    """Write cameras, poses and points as a COLMAP model (binary) into ``folder``.

    Each picture has a camera of its own, with the lens of the dataset at training size; pictures
    are named as in ``transforms.json``. Points have no tracks: they come from the field.
    """
    model = pycolmap.Reconstruction()
    for number, file in enumerate(dataset.files, start=1):
        lens = dataset.intrinsics[number - 1]
        k1, k2, p1, p2, k3 = lens.distortion
        # COLMAP counts pixels from the picture's corner.
        numbers = [lens.fx, lens.fy, lens.cx + 0.5, lens.cy + 0.5, k1, k2, p1, p2, k3, 0, 0, 0]
        camera = pycolmap.Camera(
            model="FULL_OPENCV",
            width=lens.width,
            height=lens.height,
            params=numbers,
            camera_id=number,
        )
        model.add_camera_with_trivial_rig(camera)
        name = file.relative_to(dataset.folder) if file.is_relative_to(dataset.folder) else file
        image = pycolmap.Image(name=str(name), camera_id=number, image_id=number)
        world_to_camera = inverse(dataset.T_world_cam[number - 1])[:3]
        model.add_image_with_trivial_frame(image, pycolmap.Rigid3d(world_to_camera))
    for point, colour in zip(points, colours, strict=True):
        model.add_point3D(point, pycolmap.Track(), colour)
    folder.mkdir(parents=True, exist_ok=True)
    model.write(str(folder))


def _write(file: Path, export: Callable[[str], object]) -> None:
    """Let ``export`` write a file that is complete or not there."""
    with drafted(file) as draft:
        export(str(draft))
