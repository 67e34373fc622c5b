"""Rows of a PLY element, of text or of bytes, without the GIL.

A chunk may end anywhere between values. Where a row is (`property`, `left` of its list) lives in
the parser, so that a list may be longer than a chunk and a strip of triangles longer than memory.

``file.py`` says what is wanted of a row, and words the errors.
"""

cimport cython
from libc.math cimport fabs, floor
from libc.stdint cimport int8_t, int16_t, int32_t, int64_t, uint16_t, uint32_t, uint64_t
from libc.string cimport memcpy

from bfrt.formats.text cimport (
    FOUND, MOST_CORNERS, Tokens, exact_mantissa, find_token, read_any_number,
)

import numpy as np

# The types of values, in the order of `element.TYPES`.
cdef enum:
    INT8
    UINT8
    INT16
    UINT16
    INT32
    UINT32
    FLOAT32
    FLOAT64
    INT64
    UINT64

cpdef enum Fault:
    BAD_NUMBER = 1
    NEGATIVE_COUNT
    NO_INDEX
    LONG_FACE

cdef enum:
    MOST = 4096  # properties of an element
    # What a value ends with.
    GOT = 0
    DRY = -2
    BAD = -3

MOST_PROPERTIES = MOST

cdef int SIZES[10]
SIZES[:] = [1, 1, 2, 2, 4, 4, 4, 8, 8, 8]


cdef inline void reverse(unsigned char *bytes, int size) noexcept nogil:
    cdef unsigned char byte
    cdef int i
    for i in range(size // 2):
        byte = bytes[i]
        bytes[i] = bytes[size - 1 - i]
        bytes[size - 1 - i] = byte


cdef inline double value_of(const unsigned char *at, int kind, bint swapped) noexcept nogil:
    """Return a value as a double, which is exact but for 64-bit integers beyond 2^53."""
    cdef unsigned char bytes[8]
    memcpy(bytes, at, SIZES[kind])
    if swapped:
        reverse(bytes, SIZES[kind])
    if kind == UINT8:
        return bytes[0]
    if kind == INT32:
        return (<int32_t *>bytes)[0]
    if kind == FLOAT32:
        return (<float *>bytes)[0]
    if kind == FLOAT64:
        return (<double *>bytes)[0]
    if kind == UINT32:
        return (<uint32_t *>bytes)[0]
    if kind == INT16:
        return (<int16_t *>bytes)[0]
    if kind == UINT16:
        return (<uint16_t *>bytes)[0]
    if kind == INT64:
        return <double>(<int64_t *>bytes)[0]
    if kind == UINT64:
        return <double>(<uint64_t *>bytes)[0]
    return (<int8_t *>bytes)[0]


cdef inline void widen(const unsigned char *at, int64_t n, int64_t *out) noexcept nogil:
    """Copy n indices, int32 as this machine has them."""
    cdef int32_t index
    cdef int64_t i
    for i in range(n):
        memcpy(&index, at + 4 * i, 4)
        out[i] = index


@cython.final
cdef class Rows(Tokens):
    """Take an element's rows apart.

    Parameters
    ----------
    element : Element
    wanted : Wanted
        Of each row.
    layout : {"text", "little", "big"}
        How values are written. Text has no comments: PLY's are in its header.
    line : int
        The line that text begins in.

    Attributes
    ----------
    row : int
        The row that comes next, or is bad.
    found : float
        The count or index that is bad.
    """

    cdef readonly int64_t row
    cdef readonly int fault
    cdef readonly double found
    cdef int64_t rows
    cdef int properties
    cdef int kinds[MOST]
    cdef int counts[MOST]
    cdef int columns[MOST]
    cdef int width
    cdef bint text_form
    cdef bint swapped
    cdef bint strips
    cdef bint as_is  # indices of faces lie there as this machine has them
    cdef bint bare  # as is, and a row is a list of int32 with a count of a byte, nothing else

    cdef int property
    cdef int64_t left  # items of the list that is read, -1 before its count
    cdef int64_t have  # corners of the face that is read
    cdef int64_t first  # the last two corners of a strip, of which it has had `turn`
    cdef int64_t second
    cdef int64_t turn
    cdef double values[MOST]
    cdef const unsigned char *at
    cdef const unsigned char *end

    cdef int64_t *out_items
    cdef uint32_t *out_counts
    cdef double *out_values
    cdef Py_ssize_t items
    cdef Py_ssize_t faces
    cdef object pending

    def __init__(self, element, wanted, str layout, int64_t line):
        self.properties = len(element.properties)
        if self.properties > MOST:
            raise ValueError(f"{self.properties} properties: no room for them")
        for i, each in enumerate(element.properties):
            self.kinds[i], self.counts[i] = each.kind, each.counted
            self.columns[i] = wanted.columns[i]
        self.rows = element.rows
        self.width = wanted.width
        self.strips = wanted.strips
        self.text_form = layout == "text"
        self.swapped = layout == "big"
        self.as_is = layout == "little" and not self.strips
        self.bare = (
            self.as_is and self.properties == 1 and self.counts[0] == UINT8
            and self.kinds[0] == INT32 and self.columns[0] == self.width == 0
        )
        self.row = self.property = self.fault = 0
        self.found = 0.0
        self.left = -1
        self.have = self.turn = 0
        self.text.line = line
        self.text.comments = False
        self.pending = np.empty(0, np.int64)

    @property
    def done(self):
        return self.row == self.rows

    def parse(self, const unsigned char[::1] chunk not None):
        """Read on.

        Parameters
        ----------
        chunk : (n,) uint8
            Of bytes; of text with a byte before and a NUL behind.

        Returns
        -------
        corners : (m,) int64
            Of the faces that are complete now; of strips three a triangle.
        counts : (k,) uint32
            Corners of each.
        values : (k, width) float64
            Of each row; of strips nothing.
        used : int
            Bytes.
        """
        cdef Py_ssize_t size = chunk.shape[0]
        cdef int64_t[::1] items
        cdef uint32_t[::1] counts
        cdef double[:, ::1] values
        before = len(self.pending)
        # No value takes less than a byte, no text less than two; a strip's makes three corners.
        most = size // 2 + 1 if self.text_form else size
        items_owner = np.empty(before + (3 if self.strips else 1) * most + 1, np.int64)
        items_owner[:before] = self.pending
        counts_owner = np.empty(most + 1, np.uint32)
        values_owner = np.empty((most + 1, max(self.width, 1)))
        items, counts, values = items_owner, counts_owner, values_owner
        self.out_items, self.out_counts, self.out_values = &items[0], &counts[0], &values[0, 0]
        self.items, self.faces = before, 0
        if self.text_form:
            self.take_chunk(chunk)
        elif size:
            self.at, self.end = &chunk[0], &chunk[0] + size
        else:
            self.at = self.end = NULL
        with nogil:
            self.run()
        whole = self.items - self.have
        self.pending = items_owner[whole:self.items].copy()
        if self.text_form:
            used = self.text.at - <unsigned char *>&chunk[1]
        else:
            used = size - (self.end - self.at)
        return (
            items_owner[:whole], counts_owner[:self.faces],
            values_owner[:self.faces, :self.width], used,
        )

    cdef int run(self) except -1 nogil:
        """Read rows to the end of the chunk or of the element."""
        cdef int status = GOT
        while self.row < self.rows and status == GOT:
            if self.bare and self.left < 0:
                self.take_bare()
                if self.row == self.rows:
                    break
            while self.property < self.properties and status == GOT:
                if self.counts[self.property] < 0:
                    status = self.read_scalar()
                else:
                    status = self.read_list()
                if status == GOT:
                    self.property += 1
            if status == GOT:
                self.end_row()
        return status

    cdef int end_row(self) noexcept nogil:
        if not self.strips:
            memcpy(self.out_values + self.faces * max(self.width, 1), self.values,
                   self.width * sizeof(double))
            self.out_counts[self.faces] = <uint32_t>self.have
            self.faces += 1
        self.have = self.turn = 0
        self.property = 0
        self.row += 1
        return GOT

    cdef int read_scalar(self) except -1 nogil:
        cdef double x
        cdef int status = self.next(self.kinds[self.property], &x)
        cdef int column = self.columns[self.property]
        if status == GOT and 0 <= column < self.width:
            self.values[column] = x
        return status

    cdef int read_list(self) except -1 nogil:
        cdef double x
        cdef int status
        cdef int kind = self.kinds[self.property]
        cdef bint wanted = self.columns[self.property] == self.width
        if self.left < 0:
            status = self.next(self.counts[self.property], &x)
            if status != GOT:
                return status
            self.found = x
            if not 0 <= x < 1e15 or x != floor(x):
                return self.fail(NEGATIVE_COUNT)
            if wanted and not self.strips and x > MOST_CORNERS:
                return self.fail(LONG_FACE)
            self.left = <int64_t>x
        if wanted and self.is_plain(kind):
            self.take_plain()
        while self.left > 0:
            status = self.next(kind, &x)
            if status != GOT:
                return status
            if wanted:
                self.found = x
                # Beyond, an error could not tell the index as the file has it.
                if not fabs(x) < exact_mantissa() or x != floor(x):
                    return self.fail(NO_INDEX)
                self.take(<int64_t>x)
            self.left -= 1
        self.left = -1
        return GOT

    cdef bint is_plain(self, int kind) noexcept nogil:
        """Tell whether the rest of the list is in the chunk, as integers in this machine's form."""
        return self.as_is and kind == INT32 and self.end - self.at >= 4 * self.left

    cdef void take_bare(self) noexcept nogil:
        """Read whole rows that are one index list and nothing else, as in nearly all files."""
        cdef const unsigned char *at = self.at
        cdef int64_t *out = self.out_items + self.items
        cdef uint32_t *counts = self.out_counts + self.faces
        cdef int64_t n, taken = 0
        cdef int64_t rows = self.rows - self.row
        while taken < rows and at < self.end:
            n = at[0]
            if self.end - at < 1 + 4 * n:
                break
            widen(at + 1, n, out)
            counts[taken] = <uint32_t>n
            at += 1 + 4 * n
            out += n
            taken += 1
        self.at = at
        self.items = out - self.out_items
        self.faces += taken
        self.row += taken

    cdef void take_plain(self) noexcept nogil:
        """Copy the rest of a face's indices at once."""
        widen(self.at, self.left, self.out_items + self.items)
        self.at += 4 * self.left
        self.items += self.left
        self.have += self.left
        self.left = 0

    cdef int take(self, int64_t index) noexcept nogil:
        """Add a corner of a face, or of a strip, of which every other triangle turns round."""
        cdef int64_t *out = self.out_items + self.items
        if not self.strips:
            out[0] = index
            self.items += 1
            self.have += 1
            return GOT
        if index == -1:
            self.turn = 0
            return GOT
        if self.turn >= 2:
            out[0] = self.first if self.turn % 2 == 0 else self.second
            out[1] = self.second if self.turn % 2 == 0 else self.first
            out[2] = index
            self.items += 3
            self.out_counts[self.faces] = 3
            self.faces += 1
        self.first = self.second
        self.second = index
        self.turn += 1
        return GOT

    cdef inline int next(self, int kind, double *out) except -1 nogil:
        """Read the next value."""
        if self.text_form:
            if not find_token(&self.text):
                self.text.length = 0
                return DRY
            if read_any_number(&self.text, out) != FOUND:
                return self.fail(BAD_NUMBER)
            return GOT
        if self.end - self.at < SIZES[kind]:
            return DRY
        out[0] = value_of(self.at, kind, self.swapped)
        self.at += SIZES[kind]
        return GOT

    cdef int fail(self, int fault) noexcept nogil:
        self.fault = fault
        return BAD
