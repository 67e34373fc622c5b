"""Bricks of voxels: the bricks that have a mark, and the parts of them that have none."""

from libc.stdint cimport int64_t, uint8_t
from libc.string cimport memcpy, memset


cdef bint any_mark(const uint8_t[:, :, ::1] marks, int64_t row, int64_t x) noexcept nogil:
    """Tell whether a brick that begins at (row, x) of a layer has a mark."""
    cdef int64_t k, j, i
    for k in range(marks.shape[0]):
        for j in range(row, min(row + BRICK, marks.shape[1])):
            for i in range(x, min(x + BRICK, marks.shape[2])):
                if marks[k, j, i]:
                    return True
    return False


cdef void darken(uint8_t* brick) noexcept nogil:
    """Set DARK in all voxels of those cubes of 4 a side that have no mark: walks leave them at
    once."""
    cdef int cube, corner, i, j, k
    cdef bint dark
    for cube in range(8):
        corner = ((cube & 1) << DARK_SHIFT | (cube >> 1 & 1) << (DARK_SHIFT + BRICK_SHIFT)
                  | (cube >> 2) << (DARK_SHIFT + 2 * BRICK_SHIFT))
        dark = True
        for k in range(1 << DARK_SHIFT):
            for j in range(1 << DARK_SHIFT):
                for i in range(1 << DARK_SHIFT):
                    if brick[corner + i + (j << BRICK_SHIFT) + (k << 2 * BRICK_SHIFT)]:
                        dark = False
        if dark:
            for k in range(1 << DARK_SHIFT):
                for j in range(1 << DARK_SHIFT):
                    memset(
                        brick + corner + (j << BRICK_SHIFT) + (k << 2 * BRICK_SHIFT), DARK,
                        1 << DARK_SHIFT,
                    )


def pack(const uint8_t[:, :, ::1] marks, uint8_t[:, ::1] bricks, uint8_t[:, ::1] occupied):
    """Make bricks of a layer of voxels.

    Parameters
    ----------
    marks : (8 or fewer, rows, row) uint8
        IN. The voxels.
    bricks : (n, 512) uint8
        OUT. Those that have a mark, with room for all, and DARK where their cubes have none.
    occupied : (rows, row) of bricks, uint8
        OUT. Which those are.

    Returns
    -------
    int
        Number of bricks.
    """
    cdef int64_t row, x, j, k, width, n = 0
    cdef uint8_t* brick
    with nogil:
        for row in range(occupied.shape[0]):
            for x in range(occupied.shape[1]):
                occupied[row, x] = any_mark(marks, row * BRICK, x * BRICK)
                if not occupied[row, x]:
                    continue
                brick = &bricks[n, 0]
                memset(brick, 0, BRICK_BYTES)
                width = min(BRICK, marks.shape[2] - x * BRICK)
                for k in range(marks.shape[0]):
                    for j in range(min(BRICK, marks.shape[1] - row * BRICK)):
                        memcpy(
                            brick + (k << 2 * BRICK_SHIFT) + (j << BRICK_SHIFT),
                            &marks[k, row * BRICK + j, x * BRICK], width,
                        )
                darken(brick)
                n += 1
    return n
