"""Facets of text STL, without the GIL."""

cimport cython
from libc.string cimport memcpy, strlen

from bfrt.formats.text cimport (
    FOUND, Tokens, consume, find_token, measure, pass_blanks, read_any_number,
)

import numpy as np

cdef enum:
    STEPS = 21  # tokens of a facet
    ENDLOOP = 19  # the first of those that begin with end

# A facet's tokens; NULL is a number, of the normal or of a vertex.
cdef const char *FACET[STEPS]
FACET[:] = [
    b"facet", b"normal", NULL, NULL, NULL, b"outer", b"loop",
    b"vertex", NULL, NULL, NULL, b"vertex", NULL, NULL, NULL, b"vertex", NULL, NULL, NULL,
    b"endloop", b"endfacet",
]

cdef int FIRST_VERTEX = 7  # step from which on numbers are kept


@cython.final
cdef class Facets(Tokens):
    """Take the text of solids apart.

    Words that are parted, as ``end loop``, and lines that begin with ``color`` may be there too.

    Attributes
    ----------
    failed : bool
        Whether the last token is wrong; `expected` is what should be there.
    """

    cdef readonly bint failed
    cdef int step
    cdef int have
    cdef Py_ssize_t ended  # letters of the word that is due that came apart: those of end
    cdef double values[9]

    def __init__(self):
        self.failed = False
        self.step = self.have = 0
        self.ended = 0
        self.text.comments = False

    @property
    def complete(self):
        """Tell whether the text may end here."""
        return self.step == 0

    @property
    def expected(self):
        """Return the word or thing that the grammar expects next."""
        if self.step == 0:
            return "solid, facet or endsolid"
        return "a number" if FACET[self.step] == NULL else FACET[self.step][self.ended:].decode()

    def parse(self, const unsigned char[::1] chunk not None):
        """Read a chunk on: whole tokens, with a byte before and a NUL behind.

        Returns
        -------
        (n, 9) float64
            Three vertices of each facet that is complete now.
        """
        cdef Py_ssize_t size = chunk.shape[0]
        cdef double[:, ::1] out
        # A facet's tokens take more bytes than there are tokens.
        owner = np.empty((size // STEPS + 1, 9))
        out = owner
        self.take_chunk(chunk)
        cdef Py_ssize_t count
        with nogil:
            count = self.run(&out[0, 0])
        return owner[:count]

    cdef Py_ssize_t run(self, double *out) except -1 nogil:
        cdef Py_ssize_t count = 0
        cdef double x
        while find_token(&self.text):
            if FACET[self.step] == NULL:
                if read_any_number(&self.text, &x) != FOUND:
                    self.failed = True
                    return count
                if self.step > FIRST_VERTEX:
                    self.values[self.have] = x
                    self.have += 1
                self.step += 1
            elif not self.pass_word():
                self.failed = True
                return count
            if self.step == STEPS:
                memcpy(out + 9 * count, self.values, sizeof(self.values))
                count += 1
                self.step = self.have = 0
        self.text.length = 0
        return count

    cdef bint pass_word(self) noexcept nogil:
        """Pass over the word that is due, or over text that may precede it."""
        measure(&self.text)
        if self.is_word(FACET[self.step] + self.ended):
            consume(&self.text)
            self.step += 1
            self.ended = 0
        elif self.ended:
            return False
        elif self.step == 0 and self.is_of_solid() or self.is_word(b"color"):
            self.pass_line()
        elif self.step >= ENDLOOP and self.is_word(b"end"):
            consume(&self.text)
            self.ended = 3
        else:
            return False
        return True

    cdef bint is_of_solid(self) noexcept nogil:
        """Tell whether the token begins or ends a solid, whose name goes to the line's end."""
        return self.is_word(b"solid") or self.is_word(b"endsolid") or self.is_word(b"end")

    cdef void pass_line(self) noexcept nogil:
        """Pass over the rest of the line, which may go on in the next chunk."""
        consume(&self.text)
        self.text.comment = True
        pass_blanks(&self.text)

    cdef bint is_word(self, const char *word) noexcept nogil:
        """Tell whether the token is a word, in any case."""
        cdef Py_ssize_t i
        if self.text.length != <Py_ssize_t>strlen(word):
            return False
        for i in range(self.text.length):
            if self.text.token[i] | 32 != word[i]:
                return False
        return True
