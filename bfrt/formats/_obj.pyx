"""Lines of OBJ, without the GIL: vertices or faces, in whole lines.

Both passes count vertices, of which a face's negative numbers need those before it. The first,
over vertices, also tells what the file is: statements are counted.
"""

cimport cython
from libc.stdint cimport int64_t, uint32_t
from libc.string cimport memchr

from bfrt.formats.text cimport (
    FOUND, HASH, MINUS, MOST_CORNERS, NEWLINE, NUL, PLUS, RETURN, SPACE, Tokens, consume, is_blank,
    measure, pass_blanks, read_any_number,
)

import re

import numpy as np

cdef enum:
    COLUMNS = 6
    BACKSLASH = 92
    SLASH = 47

# From this vertex on a number says too much: no file has so many, and its digits may go on.
cdef int64_t FAR = <int64_t>1 << 50

cpdef enum Fault:
    NO_NUMBER = 1
    FEW_NUMBERS
    NO_INDEX
    NO_VERTEX
    FEW_CORNERS
    MANY_CORNERS
    BINARY
    FAR_VERTEX
    NO_NORMAL

cpdef enum Statement:
    MATERIAL
    LIBRARY


#: Where a line goes on in the next.
_GOES_ON = re.compile(rb"\\(\r\n|\r|\n)")

# Statements that shape nothing bfrt draws, or only how it is shaded or named.
cdef const char *PASSED[20]
PASSED[:] = [
    b"vt", b"vn", b"vp", b"g", b"o", b"s", b"mg", b"l", b"p", b"shadow_obj", b"trace_obj",
    b"bevel", b"c_interp", b"d_interp", b"lod", b"maplib", b"usemap", b"usemtl", b"mtllib", b"call",
]


cdef inline bint is_end(unsigned char byte) noexcept nogil:
    return byte == NEWLINE or byte == RETURN


cdef inline bint ends_word(const unsigned char *at) noexcept nogil:
    """Whether a blank is here, or a backslash behind which the line goes on."""
    return is_blank(at[0]) or (at[0] == BACKSLASH and is_end(at[1]))


@cython.final
cdef class Lines(Tokens):
    """Take lines apart.

    Parameters
    ----------
    of_faces : bool
        Whether faces are wanted, and not vertices.
    fewest : int
        Corners that a face has at the least.
    of_normals : bool
        Whether normals are wanted in place of vertices, and of faces their numbers.

    Attributes
    ----------
    vertices, normals, faces : int
        Read or passed so far.
    colored : int
        Vertices that had a color.
    passed, strokes, unknown : int
        Of a pass over vertices: other statements that are known, those of them that are lines to
        draw, and those that are not known.
    stranger : (int, bytes)
        Line and word of the first that is not known.
    """

    cdef readonly int64_t vertices
    cdef readonly int64_t normals
    cdef readonly int64_t faces
    cdef readonly int64_t colored
    cdef readonly int64_t passed
    cdef readonly int64_t strokes
    cdef readonly int64_t unknown
    cdef readonly object stranger
    cdef readonly int fault
    cdef bint of_faces
    cdef bint of_normals
    cdef int64_t fewest
    cdef double *out_vertices
    cdef int64_t *out_corners
    cdef uint32_t *out_counts
    cdef Py_ssize_t rows
    cdef Py_ssize_t corners
    cdef Py_ssize_t counts
    cdef list statements

    def __init__(self, bint of_faces, int64_t fewest=3, bint of_normals=False):
        self.of_faces = of_faces
        self.of_normals = of_normals
        self.fewest = fewest
        self.vertices = self.normals = self.faces = self.colored = 0
        self.passed = self.strokes = self.unknown = 0
        self.fault = 0

    def parse(self, const unsigned char[::1] chunk not None):
        """Read whole lines, with a byte before and a NUL behind.

        Returns
        -------
        vertices : (n, 6) float64
            x y z, and r g b from 0 to 1, or -1; of normals x y z alone count.
        corners : (m,) int64
            Vertices of faces, from 0; normals from 1, and 0 for a corner without one.
        counts : (k,) uint32
            Corners of each.
        statements : list of (int, Statement, bytes)
            Of materials: the faces of the chunk that come before, what it is, and its text.
        """
        cdef Py_ssize_t size = chunk.shape[0]
        cdef double[:, ::1] vertices
        cdef int64_t[::1] corners
        cdef uint32_t[::1] counts
        # "v 0 0 0\n" and "f 1 1 1\n" are the shortest, a corner takes two bytes.
        vertices_owner = np.empty((1 if self.of_faces else size // 8 + 1, COLUMNS))
        corners_owner = np.empty(size // 2 + 1 if self.of_faces else 1, np.int64)
        counts_owner = np.empty(
            size // (2 * self.fewest + 2) + 1 if self.of_faces else 1, np.uint32
        )
        vertices, corners, counts = vertices_owner, corners_owner, counts_owner
        self.out_vertices, self.out_corners = &vertices[0, 0], &corners[0]
        self.out_counts = &counts[0]
        self.rows = self.corners = self.counts = 0
        self.statements = []
        self.take_chunk(chunk)
        with nogil:
            self.run()
        return (
            vertices_owner[:self.rows], corners_owner[:self.corners],
            counts_owner[:self.counts], self.statements,
        )

    cdef int run(self) except -1 nogil:
        while not self.fault and pass_blanks(&self.text):
            self.read_statement()
        return 0

    cdef bint in_line(self) noexcept nogil:
        """Go to the next token of the line."""
        cdef unsigned char *at = self.text.at
        while at < self.text.end and not is_end(at[0]):
            if at[0] == BACKSLASH and is_end(at[1]):
                at = self.next_line(at)
            elif is_blank(at[0]):
                at += 1
            else:
                break
        self.text.at = at
        return at < self.text.end and not is_end(at[0]) and at[0] != HASH

    cdef unsigned char *next_line(self, unsigned char *at) noexcept nogil:
        """Return the address behind a backslash and a line's end, where the line continues."""
        self.text.line += 1
        return at + (3 if at[1] == RETURN and at[2] == NEWLINE else 2)

    cdef void skip_line(self) noexcept nogil:
        """Go to where the line ends."""
        cdef unsigned char *at = self.text.at
        while at < self.text.end and not is_end(at[0]):
            if at[0] == BACKSLASH and is_end(at[1]):
                at = self.next_line(at)
            else:
                at += 1
        self.text.at = min(at, self.text.end)

    cdef int fail(self, int fault) noexcept nogil:
        self.fault = fault
        return 0

    cdef int read_statement(self) except -1 nogil:
        cdef unsigned char *at = self.text.at
        if at[0] == BACKSLASH:  # behind which the line may go on
            if not self.in_line():
                return 0
            at = self.text.at
        if at[0] == b"v" and ends_word(at + 1):
            self.text.at += 1
            self.vertices += 1
            if not (self.of_faces or self.of_normals):
                return self.read_vertex()
            self.skip_line()
            return 0
        if at[0] == b"f" and (ends_word(at + 1) or (at[1] == b"o" and ends_word(at + 2))):
            self.text.at += 2 if at[1] == b"o" else 1
            if self.of_faces:
                return self.read_face()
            self.faces += 1
        elif at[0] == b"v" and (at[1] == b"n" or at[1] == b"t") and ends_word(at + 2):
            self.passed += 1
            self.normals += at[1] == b"n"
            if at[1] == b"n" and self.of_normals and not self.of_faces:
                self.text.at += 2
                return self.read_vertex()
        elif self.of_faces:
            self.keep_material()
        else:
            self.note_statement()
        self.skip_line()
        return 0

    cdef int read_vertex(self) except -1 nogil:
        """Read x y z, and a color or -1; pass over a weight and what follows a color.

        A normal is read alike.
        """
        cdef double values[COLUMNS]
        cdef int count = 0
        cdef int i
        cdef double *out
        while count < COLUMNS and self.in_line():
            if self.read_value(&values[count]) != FOUND:
                return self.fail(NO_NUMBER)
            count += 1
        if count < 3:
            self.text.length = 0
            return self.fail(FEW_NUMBERS)
        self.skip_line()
        out = self.out_vertices + COLUMNS * self.rows
        for i in range(3):
            out[i] = values[i]
            out[3 + i] = values[3 + i] if count == COLUMNS else -1.0
        self.colored += count == COLUMNS
        self.rows += 1
        return 0

    cdef int read_value(self, double *out) except -1 nogil:
        """Read a number, which a backslash may follow without a blank."""
        cdef int status = read_any_number(&self.text, out)
        cdef unsigned char *last
        if status != FOUND and self.goes_on():
            last = self.text.token + self.text.length - 1
            last[0] = SPACE
            status = read_any_number(&self.text, out)
            last[0] = BACKSLASH
        return status

    cdef bint goes_on(self) noexcept nogil:
        """Tell whether the token ends with a backslash, so that the line continues."""
        cdef unsigned char *end = self.text.token + self.text.length
        return self.text.length > 1 and (end - 1)[0] == BACKSLASH and is_end(end[0])

    cdef int read_face(self) except -1 nogil:
        cdef int64_t index
        cdef int64_t count = 0
        while self.in_line():
            if not self.read_corner(&index):
                return 0
            if count == MOST_CORNERS:
                return self.fail(MANY_CORNERS)
            self.out_corners[self.corners + count] = index
            count += 1
        if count < self.fewest:
            self.text.length = 0
            return self.fail(FEW_CORNERS)
        self.corners += count
        self.out_counts[self.counts] = <uint32_t>count
        self.counts += 1
        self.faces += 1
        return 0

    cdef bint read_corner(self, int64_t *index) noexcept nogil:
        """Read a vertex's index; pass over the texture and the normal that slashes part from it.

        Where normals are wanted the index becomes the normal's number.
        """
        cdef Py_ssize_t i = 0
        cdef int64_t value
        cdef bint minus
        if measure(&self.text) != FOUND:
            self.fail(NO_INDEX)
            return False
        if self.goes_on():
            self.text.length -= 1
        value = self.take_number(&i, &minus)
        if value < 0:
            self.fail(NO_INDEX)
            return False
        if i < self.text.length and self.text.token[i] != SLASH:
            self.fail(NO_INDEX)
            return False
        index[0] = self.vertices - value if minus else value - 1
        if value == 0 or index[0] < 0:
            self.fail(NO_VERTEX)
            return False
        if value == FAR:
            self.fail(FAR_VERTEX)
            return False
        if self.of_normals and not self.read_corner_normal(i, index):
            return False
        consume(&self.text)
        return True

    cdef inline int64_t take_number(self, Py_ssize_t *at, bint *minus) noexcept nogil:
        """Read the whole number at a place of the token, without its sign; -1 if there is none."""
        cdef Py_ssize_t i = at[0]
        cdef int64_t value = 0
        minus[0] = i < self.text.length and self.text.token[i] == MINUS
        if minus[0] or (i < self.text.length and self.text.token[i] == PLUS):
            i += 1
        if i == self.text.length or <unsigned char>(self.text.token[i] - 48) >= 10:
            return -1
        while i < self.text.length and <unsigned char>(self.text.token[i] - 48) < 10:
            value = min(value * 10 + (self.text.token[i] - 48), FAR)
            i += 1
        at[0] = i
        return value

    cdef bint read_corner_normal(self, Py_ssize_t i, int64_t *number) noexcept nogil:
        """Read the normal's number behind a corner's second slash, from 1; 0 if it has none."""
        cdef int64_t value
        cdef bint minus
        number[0] = 0
        i += 1
        while i < self.text.length and self.text.token[i] != SLASH:
            i += 1
        i += 1
        if i > self.text.length:
            return True
        value = self.take_number(&i, &minus)
        if value < 0 or i < self.text.length:
            self.fail(NO_INDEX)
            return False
        number[0] = self.normals + 1 - value if minus else value
        if value == 0 or number[0] < 1:
            self.fail(NO_NORMAL)
            return False
        return True

    cdef void measure_word(self) noexcept nogil:
        """Find where the statement's word ends, behind which a backslash may be."""
        measure(&self.text)
        if self.goes_on():
            self.text.length -= 1

    cdef int keep_material(self) except -1 nogil:
        """Keep a statement about materials: usemtl or mtllib."""
        if self.text.at[0] != b"u" and self.text.at[0] != b"m":
            return 0
        self.measure_word()
        if self.is_word(b"usemtl") or self.is_word(b"mtllib"):
            with gil:
                self._keep()
        return 0

    cdef int note_statement(self) except -1 nogil:
        """Count a statement that is known, or unknown; one with a NUL in its line is binary."""
        cdef int i
        cdef unsigned char *begin = self.text.at
        self.measure_word()
        for i in range(20):
            if self.is_word(PASSED[i]):
                self.passed += 1
                self.strokes += self.is_word(b"l")
                return 0
        self.unknown += 1
        if self.unknown == 1:
            with gil:
                self.stranger = self.line, self.token
        self.skip_line()
        if memchr(begin, NUL, self.text.at - begin):
            return self.fail(BINARY)
        return 0

    cdef bint is_word(self, const char *word) noexcept nogil:
        cdef Py_ssize_t i = 0
        while word[i] and i < self.text.length:
            if word[i] != self.text.token[i]:
                return False
            i += 1
        return word[i] == NUL and i == self.text.length

    cdef _keep(self):
        kind = Statement.MATERIAL if self.is_word(b"usemtl") else Statement.LIBRARY
        cdef unsigned char *begin = self.text.token + self.text.length
        self.skip_line()
        text = _GOES_ON.sub(b" ", begin[:self.text.at - begin])
        self.statements.append((self.counts, kind, text.strip()))
