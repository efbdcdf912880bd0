"""What every finished field leaves in its run folder: the object's mesh and a film round it."""

from __future__ import annotations

from pathlib import Path

from server.geometry.boxes import Box3
from server.jobs.reports import tell_share
from server.jobs.worker import Reporter
from server.nerf.exports import write_mesh
from server.nerf.orbit import FRAMES, render_orbit
from server.nerf.surface import CELLS, NoSurfaceError, Surface, extract_surface
from server.nerf.training import Trainer

MESH, FILM = "mesh.glb", "orbit.mp4"
# A film with every result must not keep people from the result.
_FILM_MOST_S = 45.0


def write_results(
    trainer: Trainer,
    out: Path,
    reporter: Reporter,
    *,
    cells: int = CELLS,
    frames: int = FRAMES,
) -> str | None:
    """Write ``mesh.glb`` and ``orbit.mp4`` into ``out``; return what is missing and why, or None.

    A field without any surface has no mesh, and its film shows all that there is. When the job is
    to stop, what is not there yet stays away.

    Args:
        trainer: The field.
        out: The run folder.
        reporter: Told how far it is; asked whether to stop.
        cells: Cells of the mesh along the longest side of the object's box.
        frames: Pictures of the film.

    Raises:
        OSError: If a file cannot be written.
    """
    count = len(trainer.dataset)
    if reporter.should_stop():
        return "stopped before mesh and film were made"
    missing, around = None, None
    try:
        surface = extract_surface(trainer, cells, tell_share(reporter, "mesh", count))
        write_mesh(surface, out / MESH)
        around = bounds(surface)
    except NoSurfaceError as error:
        missing = f"no mesh: {error}"
    told = tell_share(reporter, "film", count)
    if not render_orbit(
        trainer,
        out / FILM,
        around=around,
        frames=frames,
        most_s=_FILM_MOST_S,
        on_progress=told,
        should_stop=reporter.should_stop,
    ):
        return "stopped before the film was whole"
    return missing


def bounds(surface: Surface) -> Box3:
    """Return the box of a surface."""
    return Box3(surface.vertices.min(axis=0), surface.vertices.max(axis=0))
