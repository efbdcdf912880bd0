"""The simulated room as the drones' cameras see it, drawn in software by panda3d.

Panda's own axes are x right, y forward, z up, both in the world and behind a camera; the world's
axes need no change, a camera's OpenCV axes become panda's here and nowhere else.

Symbols: ``h``, ``w`` height and width of a picture; ``s`` the supersampling factor.
"""

from __future__ import annotations

import ctypes
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from panda3d import core  # pyright: ignore[reportAttributeAccessIssue]

from server.geometry.cameras import TELLO_INTRINSICS, Intrinsics
from server.sim.meshes import Mesh, ObjectModel
from server.sim.scenes.light import floor_shadow, lit_colours
from server.sim.scenes.room import room, shadow_extent_m
from server.sim.scenes.surroundings import ORDINARY, Surroundings
from server.sim.scenes.tello import tello_body

Array = NDArray[np.float64]
Image = NDArray[np.uint8]
Mask = NDArray[np.bool_]

_NEAR_M, _FAR_M = 0.05, 30.0
# Columns: panda's camera axes (right, forward, up) in OpenCV camera axes.
_R_CAM_PANDA = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
# The software pipe snaps vertices to whole pixels; measured on markers and textures, that moves
# the picture by a quarter of a drawn pixel to the top left on average. The lens takes it back.
_SNAP_PX = (0.25, 0.25)
_CONFIG = """
window-type offscreen
audio-library-name null
load-display p3tinydisplay
aux-display
notify-level-x11display fatal
notify-level-display fatal
support-threads true
"""

# Panda's graphics engine is one per process and not thread-safe.
_engine_lock = threading.Lock()
_engine: Any = None


class WorldError(RuntimeError):
    """The simulated world cannot be drawn on this machine; its text is one line."""


class World:
    """A furnished room with one object in its middle.

    Worlds may be used from any thread, one picture at a time per process.
    """

    def __init__(
        self,
        model: ObjectModel,
        *,
        intrinsics: Intrinsics = TELLO_INTRINSICS,
        supersample: int = 1,
        seed: int = 0,
        surroundings: Surroundings = ORDINARY,
    ) -> None:
        """Build the room.

        Args:
            model: The object.
            intrinsics: Camera; without distortion.
            supersample: Draw ``s x s`` times the pixels and average them down; 2 halves the
                renderer's half-pixel errors.
            seed: Seed of the room's textures.
            surroundings: What is other than in the ordinary room.

        Raises:
            ValueError: If the camera has distortion or ``supersample`` is not 1 to 4.
            WorldError: If the software renderer cannot start.
        """
        if any(intrinsics.distortion):
            raise ValueError("intrinsics: the simulated camera has no distortion")
        if not 1 <= supersample <= 4:
            raise ValueError("supersample must be 1 to 4")
        self._intrinsics = intrinsics
        self._supersample = supersample
        lit = Mesh(model.vertices, model.faces, lit_colours(model), model.uv, model.texture)
        self._shadow = floor_shadow(model, shadow_extent_m(), seed)
        with _engine_lock:
            self._buffer, self._picture = _open_buffer(intrinsics, supersample)
            self._scene = core.NodePath("world")
            self._object = self._scene.attachNewNode(_node("object", lit))
            self._room = self._scene.attachNewNode("room")
            self._drone = core.NodePath(_node("drone", tello_body()))
            self._drones: list[core.NodePath] = []
            self._scene.setTwoSided(True)
            self._camera = self._scene.attachNewNode(
                core.Camera("camera", _lens(intrinsics, supersample))
            )
            self._buffer.makeDisplayRegion().setCamera(self._camera)
        self.furnish(seed, surroundings)

    def furnish(self, seed: int, surroundings: Surroundings) -> None:
        """Replace the room around the object.

        Args:
            seed: Seed of the room's textures.
            surroundings: What is other than in the ordinary room.
        """
        meshes = room(self._shadow, seed, surroundings)
        with _engine_lock:
            self._room.removeNode()
            self._room = self._scene.attachNewNode("room")
            for k, mesh in enumerate(meshes):
                self._room.attachNewNode(_node(f"surface {k}", mesh))
            self._object.setColorScale(*surroundings.light_rgb, 1.0)

    @property
    def intrinsics(self) -> Intrinsics:
        """The camera that takes the pictures."""
        return self._intrinsics

    def render(self, T_world_cam: Array, other_drones: Sequence[tuple[Array, float]] = ()) -> Image:
        """Return the picture ``(h, w, 3)`` BGR that a camera takes.

        Args:
            T_world_cam: ``(4, 4)`` OpenCV camera to world.
            other_drones: Position ``(3,)`` in world metres and heading in radians of each
                drone that may be in the picture.
        """
        with _engine_lock:
            self._show_drones(other_drones)
            image = self._draw(T_world_cam, (0.3, 0.28, 0.26))
        s = self._supersample
        if s == 1:
            return image
        size = (self._intrinsics.width, self._intrinsics.height)
        return cv2.resize(image, size, interpolation=cv2.INTER_AREA).astype(np.uint8, copy=False)

    def silhouette(self, T_world_cam: Array) -> Mask:
        """Return where the object is ``(h, w)``: the truth, for benches only."""
        with _engine_lock, self._object_alone():
            # What looks the same on black and on white ground is not the ground.
            on_black = self._draw(T_world_cam, (0.0, 0.0, 0.0))
            on_white = self._draw(T_world_cam, (1.0, 1.0, 1.0))
        mask = (on_black == on_white).all(axis=2)
        s = self._supersample
        if s == 1:
            return mask
        size = (self._intrinsics.width, self._intrinsics.height)
        return cv2.resize(mask.astype(np.float32), size, interpolation=cv2.INTER_AREA) >= 0.5

    def close(self) -> None:
        """Free the picture buffer; the world cannot be drawn after that."""
        with _engine_lock:
            if _engine is not None and self._buffer is not None:
                _engine.removeWindow(self._buffer)
            self._buffer = None
            self._scene.removeNode()
            self._drone.removeNode()

    def _show_drones(self, drones: Sequence[tuple[Array, float]]) -> None:
        """Put one body per drone into the scene."""
        while len(self._drones) < len(drones):
            self._drones.append(self._drone.copyTo(self._scene))
        for body, drone in zip(self._drones, drones, strict=False):
            position, yaw_rad = drone
            body.show()
            body.setPos(*(float(c) for c in position))
            body.setH(float(np.rad2deg(yaw_rad)))
        for body in self._drones[len(drones) :]:
            body.hide()

    @contextmanager
    def _object_alone(self) -> Iterator[None]:
        """Hide everything but the object for a while."""
        self._show_drones(())
        self._room.hide()
        try:
            yield
        finally:
            self._room.show()

    def _draw(self, T_world_cam: Array, ground: tuple[float, float, float]) -> Image:
        """Return the picture ``(s h, s w, 3)`` BGR of what is shown; needs the engine's lock."""
        if self._buffer is None or _engine is None:
            raise WorldError("the world is closed")
        R = np.asarray(T_world_cam, float)[:3, :3] @ _R_CAM_PANDA
        # Panda multiplies row vectors from the left: its matrix is the transpose.
        rows = np.eye(4)
        rows[:3, :3] = R.T
        rows[3, :3] = np.asarray(T_world_cam, float)[:3, 3]
        self._camera.setMat(core.LMatrix4f(*rows.reshape(-1).tolist()))
        self._buffer.setClearColor(core.LVecBase4f(*ground, 1.0))
        # The engine draws every active buffer of the process: only this one is wanted now.
        self._buffer.setActive(True)
        _engine.renderFrame()
        self._buffer.setActive(False)
        height, width = self._picture.getYSize(), self._picture.getXSize()
        data = self._picture.getRamImage()
        pixels = np.frombuffer(data, np.uint8).reshape(height, width, -1)
        # Panda stores BGRA with the bottom row first.
        return np.ascontiguousarray(pixels[::-1, :, :3])


def _open_buffer(
    intrinsics: Intrinsics, supersample: int
) -> tuple[core.GraphicsOutput, core.Texture]:
    """Return an offscreen buffer and the texture that receives its pictures; needs the lock."""
    global _engine
    if _engine is None:
        core.loadPrcFileData("", _CONFIG)
        _engine = core.GraphicsEngine()
    selection = core.GraphicsPipeSelection.getGlobalPtr()
    # Counting the pipes loads the display modules. To ask for one that did not load ends the
    # process, so look for its name first.
    kinds = [selection.getPipeType(k) for k in range(selection.getNumPipeTypes())]
    software = [kind for kind in kinds if kind.getName() == "TinyOffscreenGraphicsPipe"]
    pipe = selection.makePipe(software[0]) if software else None
    if pipe is None:
        raise WorldError(_why_no_pipe())
    wanted = core.FrameBufferProperties()
    wanted.setRgbColor(True)
    wanted.setRgbaBits(8, 8, 8, 8)
    wanted.setDepthBits(24)
    size = core.WindowProperties.size(
        intrinsics.width * supersample, intrinsics.height * supersample
    )
    flags = core.GraphicsPipe.BFRefuseWindow
    buffer = _engine.makeOutput(pipe, "camera", 0, wanted, size, flags)
    if buffer is None:
        raise WorldError("panda3d's software renderer opened no picture buffer")
    picture = core.Texture("picture")
    buffer.addRenderTexture(picture, core.GraphicsOutput.RTMCopyRam, core.GraphicsOutput.RTPColor)
    buffer.setActive(False)
    return buffer, picture


def _why_no_pipe() -> str:
    """Return one line that says why panda3d's software renderer did not load."""
    try:
        ctypes.CDLL("libX11.so.6")
    except OSError:
        return "panda3d's software renderer needs libX11.so.6: install the Debian package libx11-6"
    return "panda3d's software renderer p3tinydisplay did not load"


def _lens(intrinsics: Intrinsics, supersample: int) -> core.PerspectiveLens:
    """Return panda's lens of a camera; off-centre principal points become film offsets."""
    lens = core.PerspectiveLens()
    width, height = intrinsics.width, intrinsics.height
    # Film is measured in pixels of x; a pixel's height differs when fx and fy do.
    stretch = intrinsics.fx / intrinsics.fy
    lens.setFilmSize(width, height * stretch)
    lens.setFocalLength(intrinsics.fx)
    snap_x, snap_y = (value / supersample for value in _SNAP_PX)
    offset_x = width / 2 - (intrinsics.cx + 0.5 + snap_x)
    offset_y = (intrinsics.cy + 0.5 + snap_y) - height / 2
    lens.setFilmOffset(offset_x, offset_y * stretch)
    lens.setNearFar(_NEAR_M, _FAR_M)
    return lens


def _node(name: str, mesh: Mesh) -> core.GeomNode:
    """Return panda's node of a mesh."""
    n = len(mesh.vertices)
    textured = mesh.uv is not None and mesh.texture is not None
    layout = core.GeomVertexFormat.getV3c4t2() if textured else core.GeomVertexFormat.getV3c4()
    fields = [("v", "<f4", 3), ("c", "u1", 4)] + ([("t", "<f4", 2)] if textured else [])
    rows = np.zeros(n, dtype=fields)
    rows["v"] = mesh.vertices
    rows["c"][:, :3] = mesh.colours
    rows["c"][:, 3] = 255
    if mesh.uv is not None and textured:
        rows["t"] = mesh.uv
    data = core.GeomVertexData(name, layout, core.Geom.UHStatic)
    data.uncleanSetNumRows(n)
    data.modifyArrayHandle(0).copyDataFrom(rows.tobytes())
    triangles = core.GeomTriangles(core.Geom.UHStatic)
    triangles.setIndexType(core.Geom.NTUint32)
    indices = triangles.modifyVertices()
    indices.uncleanSetNumRows(mesh.faces.size)
    indices.modifyHandle().copyDataFrom(mesh.faces.astype("<u4").tobytes())
    geometry = core.Geom(data)
    geometry.addPrimitive(triangles)
    node = core.GeomNode(name)
    state = core.RenderState.makeEmpty()
    if mesh.texture is not None:
        state = state.setAttrib(core.TextureAttrib.make(_texture(name, mesh.texture)))
        if (mesh.texture[..., 3] < 128).any():
            test = core.AlphaTestAttrib.make(core.RenderAttrib.MGreaterEqual, 0.5)
            state = state.setAttrib(test)
    node.addGeom(geometry, state)
    return node


def _texture(name: str, picture: Image) -> core.Texture:
    """Return panda's texture of an RGBA picture, row 0 at the top, with mipmaps."""
    height, width = picture.shape[:2]
    texture = core.Texture(name)
    texture.setup2dTexture(width, height, core.Texture.TUnsignedByte, core.Texture.FRgba)
    bgra = np.ascontiguousarray(picture[::-1, :, [2, 1, 0, 3]])
    texture.setRamImage(bgra.tobytes())
    texture.setMinfilter(core.SamplerState.FTLinearMipmapLinear)
    texture.setMagfilter(core.SamplerState.FTLinear)
    # Panda need not keep its own copy once the renderer has one.
    texture.setKeepRamImage(False)
    texture.setWrapU(core.SamplerState.WMClamp)
    texture.setWrapV(core.SamplerState.WMClamp)
    return texture
