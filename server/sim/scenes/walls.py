"""Pictures of the four walls with what hangs on them: windows, a door, posters, a whiteboard.

Pictures are RGB, 11 m wide and 4.2 m high, row 0 at the ceiling, as seen from inside the room.
"""

from __future__ import annotations

import cv2
import numpy as np

from server.sim.scenes.surfaces import Grid, Noise, Picture, bricks, cloth, plaster, toned

WIDTH_M, HEIGHT_M = 11.0, 4.2
_COLUMNS, _ROWS = 3072, 1024


def wall_pictures(seed: int) -> list[Picture]:
    """Return the walls at +Y (windows), +X (brick), -Y (door, boards), -X (wallpaper, posters)."""
    noise = Noise(seed + 1)
    return [_window_wall(noise), _brick_wall(noise), _door_wall(noise), _poster_wall(noise)]


def _grid(offset_m: float) -> Grid:
    """Return a wall's grid; each wall takes its noise from another place."""
    return Grid(offset_m, 0.0, WIDTH_M, HEIGHT_M, _COLUMNS, _ROWS)


def _place(
    wall: Picture, x_m: float, z_m: float, width_m: float, height_m: float, item: Picture
) -> None:
    """Paint ``item`` on a wall, ``x_m`` from its left edge and ``z_m`` above the floor."""
    c0, c1 = (round(x * _COLUMNS / WIDTH_M) for x in (x_m, x_m + width_m))
    r0, r1 = (round((HEIGHT_M - z) * _ROWS / HEIGHT_M) for z in (z_m + height_m, z_m))
    # A soft shadow on the wall makes the item stand off a little.
    pad = 10
    region = wall[max(r0 - pad, 0) : r1 + pad, max(c0 - pad, 0) : c1 + pad]
    shade = np.ones(region.shape[:2], np.float32)
    shade[pad + 4 : pad + 4 + r1 - r0, pad - 3 : pad - 3 + c1 - c0] = 0.62
    region[:] = (region * cv2.GaussianBlur(shade, (0, 0), 4.0)[..., None]).astype(np.uint8)
    interpolation = cv2.INTER_AREA if item.shape[1] >= c1 - c0 else cv2.INTER_LINEAR
    wall[r0:r1, c0:c1] = cv2.resize(item, (c1 - c0, r1 - r0), interpolation=interpolation)


def _skirting(wall: Picture, rgb: tuple[int, int, int]) -> None:
    """Paint a skirting board along the floor."""
    rows = round(0.11 * _ROWS / HEIGHT_M)
    grain = np.random.default_rng(3).normal(0, 5, (rows, _COLUMNS, 1))
    wall[-rows:] = np.clip(
        np.asarray(rgb) + cv2.GaussianBlur(grain, (0, 0), 1.5)[..., None] * 2, 0, 255
    )
    wall[-rows - 2 : -rows] = (wall[-rows - 2 : -rows] * 0.6).astype(np.uint8)


def _window_wall(noise: Noise) -> Picture:
    wall = plaster(_grid(0.0), noise, (150, 152, 148), (206, 207, 200))
    _skirting(wall, (196, 192, 184))
    for k, x_m in enumerate((1.1, 4.4, 7.7)):
        _place(wall, x_m, 1.0, 2.1, 2.4, _window(noise, k))
        _place(wall, x_m + 0.25, 0.2, 1.6, 0.6, _radiator())
    return wall


def _window(noise: Noise, k: int) -> Picture:
    """Return a window with a frame and a view of trees and houses under a pale sky."""
    size = (420, 480)
    grid = Grid(5.0 * k, 0.0, 4.2, 4.8, *size)
    sky = toned(0.6 * noise.octaves(grid, 200, 2.0, 5), (164, 184, 204), (224, 230, 234))
    y = grid.y[:, None]
    line = 2.5 + 0.5 * noise.octaves(grid, 210, 1.2, 5)
    leaves = toned(noise.octaves(grid, 220, 0.3, 6, 0.8), (44, 62, 38), (124, 142, 84))
    view = np.where((y > line)[..., None], leaves, sky)
    house = ((grid.x[None, :] * 0.7 + 0.6 * k) % 2.4 < 1.0) & (y > 1.7 + 0.25 * np.sin(4.0 * k))
    front = toned(0.5 * noise.octaves(grid, 230, 0.4, 4), (138, 112, 92), (190, 168, 142))
    panes = (np.sin(grid.x[None, :] * 16) > 0.3) & (np.sin(y * 13) > 0.2)
    front[panes & house] = (74, 82, 92)
    view = np.where((house & (y < line + 0.7))[..., None], front, view)
    view = np.ascontiguousarray(view)
    for x0, x1 in ((0, 16), (202, 218), (404, 420)):
        view[:, x0:x1] = (226, 224, 218)
        view[:, x1 - 2 : x1] = (150, 148, 142)
    for y0, y1 in ((0, 16), (150, 162), (462, 480)):
        view[y0:y1] = (226, 224, 218)
        view[y1 - 2 : y1] = (150, 148, 142)
    return view


def _radiator() -> Picture:
    x = np.arange(320)
    ribs = 196 + 34 * np.sin(2 * np.pi * x / 16)
    picture = np.repeat(np.repeat(ribs[None, :, None], 120, 0), 3, 2)
    picture[:12] *= 0.85
    picture[-12:] *= 0.75
    return picture.astype(np.uint8)


def _brick_wall(noise: Noise) -> Picture:
    wall = bricks(_grid(20.0), noise)
    _skirting(wall, (92, 76, 62))
    for k, (x_m, z_m, width_m, height_m) in enumerate(
        ((1.3, 1.5, 1.3, 0.9), (3.3, 1.2, 0.7, 1.0), (6.9, 1.4, 1.6, 1.1), (9.2, 1.7, 0.8, 0.8))
    ):
        _place(wall, x_m, z_m, width_m, height_m, _painting(noise, k))
    return wall


def _painting(noise: Noise, k: int) -> Picture:
    """Return a framed landscape: hills, water, sky."""
    grid = Grid(7.0 * k, 30.0, 3.2, 2.4, 320, 240)
    y = grid.y[:, None] - 30.0
    picture = toned(0.7 * noise.octaves(grid, 240, 1.0, 6), (120, 146, 168), (226, 214, 190))
    hues = [
        ((56, 74, 62), (128, 140, 98)),
        ((84, 62, 46), (168, 132, 84)),
        ((38, 52, 72), (98, 124, 142)),
    ]
    for layer in range(3):
        dark, light = hues[(layer + k) % 3]
        ridge = 0.9 + 0.5 * layer + 0.3 * noise.octaves(grid, 250 + 8 * layer, 0.9, 5)
        hill = toned(noise.octaves(grid, 280 + 8 * layer, 0.25, 5, 0.8), dark, light)
        picture = np.where((y > ridge)[..., None], hill, picture)
    return _framed(_framed(picture, 6, (226, 220, 206)), 12, (70, 48, 32))


def _framed(picture: Picture, width_px: int, rgb: tuple[int, int, int]) -> Picture:
    """Return ``picture`` inside a frame."""
    rows, columns = picture.shape[:2]
    framed = np.empty((rows + 2 * width_px, columns + 2 * width_px, 3), np.uint8)
    framed[:] = rgb
    framed[width_px:-width_px, width_px:-width_px] = picture
    return framed


def _door_wall(noise: Noise) -> Picture:
    wall = plaster(_grid(40.0), noise, (164, 156, 138), (214, 206, 186))
    _skirting(wall, (150, 132, 108))
    _place(wall, 8.2, 0.0, 1.05, 2.15, _door(noise))
    _place(wall, 3.6, 1.0, 2.6, 1.3, _whiteboard())
    _place(wall, 1.0, 1.1, 1.5, 1.1, _cork_board(noise))
    _place(wall, 9.75, 1.15, 0.1, 0.14, np.full((16, 12, 3), 232, np.uint8))
    _place(wall, 6.9, 2.0, 0.55, 0.55, _clock())
    return wall


def _door(noise: Noise) -> Picture:
    grid = Grid(60.0, 0.0, 1.05, 2.15, 320, 640)
    value = 0.6 * noise.field(grid, 300, 0.02, 0.5) + 0.4 * noise.octaves(grid, 302, 0.3, 4)
    door = toned(0.7 * value, (98, 66, 44), (152, 112, 78))
    for r0, r1 in ((60, 270), (330, 590)):
        for c0, c1 in ((44, 144), (176, 276)):
            door[r0:r1, c0:c1] = (door[r0:r1, c0:c1] * 0.86).astype(np.uint8)
            cv2.rectangle(door, (c0, r0), (c1, r1), (70, 46, 30), 4)
            cv2.line(door, (c0, r1), (c1, r1), (178, 138, 102), 3)
    cv2.rectangle(door, (0, 0), (319, 639), (196, 186, 168), 22)
    cv2.circle(door, (288, 345), 9, (196, 192, 180), -1)
    cv2.line(door, (288, 345), (258, 345), (196, 192, 180), 7)
    return door


def _whiteboard() -> Picture:
    board = np.full((520, 1040, 3), (232, 234, 232), np.uint8)
    rng = np.random.default_rng(8)
    inks = [(34, 44, 120), (150, 34, 36), (30, 96, 52), (40, 40, 44)]
    board = np.clip(
        board + cv2.GaussianBlur(rng.normal(0, 40, board.shape), (0, 0), 14) * 1.6, 0, 255
    )
    board = board.astype(np.uint8)
    lines = [
        "O(C, Cbox) = unit(C - Cbox) . n",
        "todo: props, batteries x8",
        "F' = exp(-e^2 / 2t^2)",
        "drone 3: trim yaw",
    ]
    for k, line in enumerate(lines):
        place = (40 + int(rng.integers(0, 60)), 90 + 110 * k)
        cv2.putText(
            board, line, place, cv2.FONT_HERSHEY_SCRIPT_SIMPLEX, 1.3, inks[k], 3, cv2.LINE_AA
        )
    cv2.ellipse(board, (830, 270), (120, 110), 0, 0, 360, inks[3], 4, cv2.LINE_AA)
    for k in range(4):
        angle = 0.4 + k * np.pi / 2
        tip = (int(830 + 120 * np.cos(angle)), int(270 + 110 * np.sin(angle)))
        cv2.circle(board, tip, 16, inks[k], 4, cv2.LINE_AA)
        cv2.arrowedLine(
            board, tip, (int(830 + 50 * np.cos(angle)), int(270 + 45 * np.sin(angle))), inks[k], 3
        )
    cv2.rectangle(board, (0, 0), (1039, 519), (150, 152, 156), 14)
    return board


def _cork_board(noise: Noise) -> Picture:
    grid = Grid(70.0, 0.0, 1.5, 1.1, 600, 440)
    board = toned(0.8 * noise.octaves(grid, 310, 0.02, 3, 0.8), (128, 90, 56), (186, 146, 100))
    rng = np.random.default_rng(11)
    for _ in range(13):
        x, y = int(rng.integers(15, 500)), int(rng.integers(15, 350))
        width, height = int(rng.integers(50, 95)), int(rng.integers(45, 85))
        paper = rng.integers(170, 240, 3)
        board[y : y + height, x : x + width] = paper
        for line in range(y + 10, y + height - 6, 8):
            end = x + int(width * rng.uniform(0.45, 0.92))
            cv2.line(board, (x + 6, line), (end, line), tuple(int(c) for c in paper // 3), 2)
        cv2.circle(board, (x + width // 2, y + 5), 4, (176, 40, 40), -1)
    cv2.rectangle(board, (0, 0), (599, 439), (96, 66, 42), 14)
    return board


def _clock() -> Picture:
    clock = np.full((160, 160, 3), (190, 182, 164), np.uint8)
    cv2.circle(clock, (80, 80), 76, (60, 60, 64), -1, cv2.LINE_AA)
    cv2.circle(clock, (80, 80), 68, (238, 238, 232), -1, cv2.LINE_AA)
    for k in range(12):
        direction = np.array([np.sin(k * np.pi / 6), -np.cos(k * np.pi / 6)])
        start, end = (tuple(int(c) for c in 80 + r * direction) for r in (54, 63))
        cv2.line(clock, start, end, (40, 40, 44), 4, cv2.LINE_AA)
    cv2.line(clock, (80, 80), (48, 60), (30, 30, 34), 6, cv2.LINE_AA)
    cv2.line(clock, (80, 80), (96, 28), (30, 30, 34), 4, cv2.LINE_AA)
    return clock


def _poster_wall(noise: Noise) -> Picture:
    grid = _grid(60.0)
    wall = cloth(grid, noise, (108, 124, 124), (158, 172, 166))
    stripe = np.sin(grid.x * (2 * np.pi / 0.42))[None, :, None]
    wall = (wall * (0.94 + 0.06 * np.sign(stripe))).astype(np.uint8)
    _skirting(wall, (204, 200, 190))
    titles = ["ORBITS", "BIRDS OF THE COAST", "GEOLOGY", "JAZZ", "TUNDRA", "MAP"]
    for k, title in enumerate(titles):
        x_m = 0.7 + 1.72 * k
        _place(wall, x_m, 1.25 + 0.25 * (k % 2), 0.84, 1.2, _poster(noise, k, title))
    return wall


def _poster(noise: Noise, k: int, title: str) -> Picture:
    """Return a poster: an abstract print with a title and small text."""
    rng = np.random.default_rng(40 + k)
    grid = Grid(9.0 * k, 50.0, 0.84, 1.2, 280, 400)
    field = noise.octaves(grid, 320, 0.3, 5, 0.6)
    raw = rng.integers(50, 220, (5, 3))
    # Halfway to grey: printed paper, not neon.
    palette = np.clip((raw + raw.mean(axis=1, keepdims=True)) / 2 * [1.06, 1.0, 0.9], 0, 255)
    bands = np.clip(np.floor((field + 1.6) * 1.6), 0, 4).astype(np.int64)
    print_ = palette[bands] * (1.0 + 0.06 * noise.field(grid, 330, 0.008))[..., None]
    poster = np.clip(print_, 0, 255).astype(np.uint8)
    for _ in range(4):
        centre = (int(rng.integers(40, 240)), int(rng.integers(90, 300)))
        ink = tuple(int(c) for c in rng.integers(20, 240, 3))
        cv2.circle(
            poster, centre, int(rng.integers(14, 46)), ink, int(rng.integers(2, 9)), cv2.LINE_AA
        )
    poster[:58] = (226, 220, 204)
    poster[-64:] = (226, 220, 204)
    scale = min(1.2, 13.0 / len(title))
    cv2.putText(
        poster, title, (12, 42), cv2.FONT_HERSHEY_DUPLEX, scale, (36, 34, 40), 2, cv2.LINE_AA
    )
    for line in range(4):
        end = 16 + int(rng.integers(150, 250))
        cv2.line(poster, (16, 350 + 12 * line), (end, 350 + 12 * line), (84, 80, 84), 4)
    cv2.rectangle(poster, (0, 0), (279, 399), (238, 236, 228), 8)
    return poster
