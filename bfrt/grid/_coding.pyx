"""Bricks of marks as they are on disk: most voxels of a brick are alike.

::

    brick    |mask: a bit a voxel  |common|others...        |
              1 where it has the    1 byte 1 byte each, in
              common mark, 64 bytes        the voxels' order
"""

from libc.stdint cimport int64_t, uint8_t, uint64_t
from libc.string cimport memcpy, memset

from bfrt.bits cimport lowest_bit, ones
from bfrt.grid.bricks cimport BRICK_BYTES
from bfrt.streams.reader cimport Reader, take

cdef enum:
    WORDS = BRICK_BYTES // 64      # of the mask
    HEAD = BRICK_BYTES // 8 + 1

#: Bytes of a coded brick of which all voxels but one differ from the common mark.
MOST_CODED = HEAD + BRICK_BYTES - 1


cdef uint8_t commonest(const uint8_t* brick) noexcept nogil:
    """Return the mark that most voxels of a brick have."""
    cdef int count[256]
    cdef int i, best = 0
    memset(&count[0], 0, sizeof(count))
    for i in range(BRICK_BYTES):
        count[brick[i]] += 1
    for i in range(256):
        if count[i] > count[best]:
            best = i
    return <uint8_t>best


def encode(const uint8_t[:, ::1] bricks, uint8_t[::1] out):
    """Code bricks.

    Parameters
    ----------
    bricks : (n, 512) uint8
        IN.
    out : (n * MOST_CODED or more,) uint8
        OUT.

    Returns
    -------
    int
        Bytes that they take.
    """
    cdef int64_t at = 0, i
    cdef uint64_t word
    cdef uint8_t common
    cdef int w, k
    with nogil:
        for i in range(bricks.shape[0]):
            common = commonest(&bricks[i, 0])
            out[at + HEAD - 1] = common
            k = HEAD
            for w in range(WORDS):
                word = others(&bricks[i, 64 * w], common, &out[at], &k)
                memcpy(&out[at + 8 * w], &word, 8)
            at += k
    return at


cdef uint64_t others(const uint8_t* voxels, uint8_t common, uint8_t* out, int* k) noexcept nogil:
    """Add the voxels, of 64, with another mark than `common`; return as bits which have it."""
    cdef uint64_t word = 0
    cdef int j
    for j in range(64):
        if voxels[j] == common:
            word |= <uint64_t>1 << j
        else:
            out[k[0]] = voxels[j]
            k[0] += 1
    return word


def decode(Reader reader, uint8_t[:, ::1] bricks):
    """Read coded bricks.

    Parameters
    ----------
    reader : Reader
        Its window holds them, and nothing else.
    bricks : (n, 512) uint8
        OUT.

    Raises
    ------
    ShortReadError
        If the window ends before them.
    """
    cdef const uint8_t* other
    cdef uint64_t mask[WORDS]
    cdef uint64_t word
    cdef uint8_t common
    cdef int64_t i
    cdef int w, n
    with nogil:
        for i in range(bricks.shape[0]):
            other = take(reader, HEAD)
            memcpy(&mask[0], other, sizeof(mask))
            common = other[HEAD - 1]
            n = BRICK_BYTES
            for w in range(WORDS):
                n -= ones(mask[w])
            other = take(reader, n)
            memset(&bricks[i, 0], common, BRICK_BYTES)
            for w in range(WORDS):
                word = ~mask[w]
                while word:
                    bricks[i, 64 * w + lowest_bit(word)] = other[0]
                    word &= word - 1
                    other += 1
