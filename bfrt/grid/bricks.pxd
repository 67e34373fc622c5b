"""Marks come in bricks; where there are none is known of cubes of three sizes."""

cpdef enum:
    DARK_SHIFT = 2            # 4 voxels a side: a bit of each of their marks
    DARK = 1 << 6
    BRICK_SHIFT = 3           # a brick: it is not there
    BRICK = 1 << BRICK_SHIFT
    BRICK_BYTES = 1 << 3 * BRICK_SHIFT
    EMPTY_BRICK = -1
    CUBE_SHIFT = 4            # 2 bricks a side: none of them is there
    EMPTY_CUBE = -2
