"""Text as readers of scenes have it: blanks, tokens, lines and numbers, without the GIL.

A text is a buffer with one byte before what is read and a NUL behind it. The NUL ends every inner
loop: only what stops at a NUL compares with ``end``. Tokens have at most ``TOKEN_BYTES``; blanks
part them, and where columns have one their separator. In formats that have comments a ``#`` where
a token may begin is one's, which the line ends; ``1.#IND`` is one token.
"""

from libc.math cimport isinf
from libc.stdint cimport int64_t, uint64_t
from libc.string cimport memcpy

cdef extern from "Python.h":
    double PyOS_string_to_double(const char *text, char **end, void *overflow) except? -1.0

cdef extern from *:
    """
    /* The powers of ten that a double holds exactly. */
    static const double POWERS[23] = {
        1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11,
        1e12, 1e13, 1e14, 1e15, 1e16, 1e17, 1e18, 1e19, 1e20, 1e21, 1e22,
    };
    """
    const double POWERS[23]

cdef enum:
    TOKEN_BYTES = 64
    NUL = 0
    NEWLINE = 10
    RETURN = 13
    SPACE = 32
    HASH = 35
    PLUS = 43
    MINUS = 45
    POINT = 46
    LOWER_E = 101
    LAST_ASCII = 126

cpdef enum:
    MOST_CORNERS = 1 << 20  # of a face of a mesh, or of a polygon of NFF

# What a look at the text ends with. Never -1, which is an exception.
cdef enum Look:
    STARVED = -2  # the token may go on in the next chunk
    FOUND = 0
    NOT_ASCII = 2
    ENDLESS  # longer than a token may be
    NO_NUMBER
    NO_FINITE
    NO_INTEGER

cdef inline uint64_t exact_mantissa() noexcept nogil:
    return 1ull << 53


cdef struct Text:
    unsigned char *at  # the next byte; the one before is always there
    unsigned char *end  # holds a NUL
    unsigned char *token  # the last token that was looked at
    Py_ssize_t length
    int64_t line
    bint ended  # no chunk follows
    bint comments  # whether a # where a token may begin is a comment's
    bint comment  # the chunk ended inside a comment
    unsigned char separator  # ends a token as a blank does; a blank where nothing else does


cdef class Tokens:
    cdef Text text
    cdef void take_chunk(self, const unsigned char[::1] chunk)


# The way of few numbers is no part of the loops that call it.
cdef int read_no_finite(Text *text, int status, double *out) noexcept nogil


cdef inline bint is_blank(unsigned char byte) noexcept nogil:
    return byte == SPACE or 9 <= byte <= 13


cdef inline bint ends_token(Text *text, unsigned char byte) noexcept nogil:
    return is_blank(byte) or byte == text.separator


cdef inline bint pass_blanks(Text *text) noexcept nogil:
    """Pass over blanks and comments, and count lines: they end with LF, CR LF or CR."""
    cdef unsigned char *at = text.at
    cdef unsigned char byte
    while at < text.end:
        byte = at[0]
        if byte == NEWLINE or byte == RETURN:
            text.comment = False
            text.line += byte == RETURN or (at - 1)[0] != RETURN
        elif not text.comment:
            if byte == HASH and text.comments:
                text.comment = True
            elif not is_blank(byte):
                break
        at += 1
    text.at = at
    return at < text.end


cdef inline bint find_token(Text *text) noexcept nogil:
    """Go to the next token; False if the chunk has no more."""
    if text.at[0] == SPACE:
        text.at += 1
    if text.at[0] > SPACE and text.at[0] != HASH:
        return True
    return pass_blanks(text)


cdef inline int measure(Text *text) noexcept nogil:
    """Find where the token ends, and whether it may be one.

    The answer hangs on the token or on its first 65 bytes, never on where the chunk ends.
    """
    cdef unsigned char *at = text.at
    cdef Py_ssize_t length = 0
    cdef bint binary = False
    while length <= TOKEN_BYTES and at + length < text.end:
        if ends_token(text, at[length]):
            break
        binary |= at[length] == NUL or at[length] > LAST_ASCII
        length += 1
    if at + length == text.end and length <= TOKEN_BYTES and not text.ended:
        return STARVED
    text.token = at
    text.length = length
    if binary:
        return NOT_ASCII
    return ENDLESS if length > TOKEN_BYTES else FOUND


cdef inline void consume(Text *text) noexcept nogil:
    text.at = text.token + text.length


cdef inline int read_hard_number(Text *text, unsigned char *stop, double *out) except -1 nogil:
    """Read a number that the fast path leaves: long, extreme, unfinished, or no number at all.

    `stop` is where a well-formed number ends, NULL if there is none.
    """
    cdef char copy[TOKEN_BYTES + 1]
    cdef int status = measure(text)
    if status != FOUND:
        return status
    if stop != text.token + text.length:
        return NO_NUMBER
    memcpy(copy, text.token, text.length)
    copy[text.length] = 0
    with gil:
        out[0] = PyOS_string_to_double(copy, NULL, NULL)
    if isinf(out[0]):
        return NO_FINITE
    consume(text)
    return FOUND


cdef inline int read_number(Text *text, double *out) except -1 nogil:
    """Read the token as the double nearest to it.

    A mantissa up to 2^53 and a power of ten up to 10^22 are exact doubles, so that one
    multiplication or division rounds correctly (Clinger 1990). All else takes the hard way.
    """
    cdef unsigned char *at = text.at
    cdef unsigned char *mark
    cdef uint64_t mantissa = 0
    cdef Py_ssize_t digits
    cdef int exponent = 0
    cdef int power = 0
    cdef bint minus = at[0] == MINUS
    cdef bint power_minus
    cdef double x
    if minus or at[0] == PLUS:
        at += 1
    mark = at
    while <unsigned char>(at[0] - 48) < 10:
        mantissa = mantissa * 10 + <unsigned char>(at[0] - 48)
        at += 1
    digits = at - mark
    if at[0] == POINT:
        at += 1
        mark = at
        while <unsigned char>(at[0] - 48) < 10:
            mantissa = mantissa * 10 + <unsigned char>(at[0] - 48)
            at += 1
        digits += at - mark
        # Too long a fraction goes the hard way before this number matters.
        exponent = <int>(mark - at)
    if digits == 0:
        return read_hard_number(text, NULL, out)
    if at[0] | 32 == LOWER_E:
        at += 1
        power_minus = at[0] == MINUS
        if power_minus or at[0] == PLUS:
            at += 1
        mark = at
        while <unsigned char>(at[0] - 48) < 10:
            if power < 10000:
                power = power * 10 + <unsigned char>(at[0] - 48)
            at += 1
        if at == mark:
            return read_hard_number(text, NULL, out)
        exponent += -power if power_minus else power
    # 19 digits cannot have overflowed the mantissa. A NUL is no blank: a number that the chunk
    # ends with goes the hard way, too.
    if (
        digits > 19
        or mantissa > exact_mantissa()
        or not -22 <= exponent <= 22
        or at - text.at > TOKEN_BYTES
        or not ends_token(text, at[0])
    ):
        return read_hard_number(text, at, out)
    x = <double>mantissa
    x = x / POWERS[-exponent] if exponent < 0 else x * POWERS[exponent]
    out[0] = -x if minus else x
    text.token = text.at
    text.length = at - text.at
    text.at = at
    return FOUND


cdef inline int read_integer(Text *text, int low, int high, double *out) noexcept nogil:
    """Read the token as an integer from `low` to `high`: digits, with or without a plus."""
    cdef int status = measure(text)
    cdef Py_ssize_t i = 0
    cdef int64_t value = 0
    if status != FOUND:
        return status
    if text.token[0] == PLUS:
        i = 1
    if i == text.length:
        return NO_INTEGER
    while i < text.length:
        if <unsigned char>(text.token[i] - 48) >= 10:
            return NO_INTEGER
        value = min(value * 10 + <unsigned char>(text.token[i] - 48), <int64_t>high + 1)
        i += 1
    if not low <= value <= high:
        return NO_INTEGER
    out[0] = <double>value
    consume(text)
    return FOUND


cdef inline int read_any_number(Text *text, double *out) except -1 nogil:
    """Read the token as `read_number` does, or as what C's printf makes of infinity and NaN."""
    cdef int status = read_number(text, out)
    return FOUND if status == FOUND else read_no_finite(text, status, out)
