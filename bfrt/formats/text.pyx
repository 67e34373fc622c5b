"""The common part of text parsers; its loops are in ``text.pxd``."""

from libc.math cimport INFINITY, NAN


cdef class Tokens:
    """Reads a text token by token, and knows the line.

    A parser begins before its first chunk; it takes chunks of whole tokens, unless it carries over
    by itself what a chunk ends with, as NFF's does.
    """

    def __cinit__(self):
        self.text.line = 1
        self.text.ended = True  # no token goes on in the next chunk
        self.text.comments = True
        self.text.comment = False
        self.text.separator = SPACE
        self.text.length = 0

    @property
    def line(self):
        """Return the line number of the last token."""
        return self.text.line

    @property
    def token(self):
        """Return the last token, empty at the end of the file."""
        return self.text.token[:self.text.length]

    cdef void take_chunk(self, const unsigned char[::1] chunk):
        """Go to the begin of a chunk, which has a byte before it and a NUL behind."""
        self.text.at = self.text.token = <unsigned char *>&chunk[1]
        self.text.end = <unsigned char *>&chunk[chunk.shape[0] - 1]
        self.text.length = 0
        if self.text.comment:
            pass_blanks(&self.text)


cdef int read_no_finite(Text *text, int status, double *out) noexcept nogil:
    """Read a token that `read_number` did not, if it is infinite or not a number as printf has it.

    MSVC's writes 1.#INF, 1.#IND, 1.#QNAN and 1.#SNAN, with what digits and exponent were asked for.
    """
    cdef Py_ssize_t sign
    if status != NO_FINITE and status != NO_NUMBER:
        return status
    sign = text.token[0] == MINUS or text.token[0] == PLUS
    if status == NO_FINITE or is_infinite(text, sign):
        out[0] = -INFINITY if text.token[0] == MINUS else INFINITY
    elif is_nan(text, sign):
        out[0] = NAN
    else:
        return status
    consume(text)
    return FOUND


cdef bint is_infinite(Text *text, Py_ssize_t sign) noexcept nogil:
    """Tell whether the token, behind its sign, is an infinity."""
    cdef Py_ssize_t end = spells(text, sign, "infinity") or spells(text, sign, "inf")
    return end == text.length or spells(text, sign, "1.#inf") > 0


cdef bint is_nan(Text *text, Py_ssize_t sign) noexcept nogil:
    """Tell whether the token, behind its sign, is nan, nan(...), or one of MSVC's forms."""
    cdef Py_ssize_t end = spells(text, sign, "nan")
    return (
        end == text.length
        or (end > 0 and text.token[end] == b"(")
        or spells(text, sign, "1.#ind") > 0
        or spells(text, sign, "1.#qnan") > 0
        or spells(text, sign, "1.#snan") > 0
    )


cdef Py_ssize_t spells(Text *text, Py_ssize_t skip, const char *word) noexcept nogil:
    """Return where `word`, in any case, ends in the token behind `skip` bytes; 0 if not there."""
    cdef Py_ssize_t i = 0
    while word[i]:
        if skip + i >= text.length or text.token[skip + i] | 32 != word[i]:
            return 0
        i += 1
    return skip + i
