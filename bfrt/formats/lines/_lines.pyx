"""Lines of numbers, without the GIL: columns of which some are wanted, or as many as there are.

Columns are parted by blanks, or by a separator, beside which there may be blanks. Then a field may
be empty, which is no number (NaN), or in quotes.

``columns.py`` says which columns are wanted, and words the errors.
"""

cimport cython
from libc.math cimport NAN
from libc.stdint cimport int64_t, uint32_t

from bfrt.formats.text cimport (
    FOUND, HASH, NEWLINE, NUL, RETURN, SPACE, Text, Tokens, is_blank, measure, read_any_number,
)

import numpy as np

cpdef enum Fault:
    NO_NUMBER = 1
    OTHER_COLUMNS

cdef enum:
    WIDEST = 4096  # columns of a line
    QUOTE = 34

MOST_COLUMNS = WIDEST


cdef inline bint is_end(unsigned char byte) noexcept nogil:
    return byte == NEWLINE or byte == RETURN


cdef inline bint is_gap(Text *text, unsigned char byte) noexcept nogil:
    """Tell whether a byte is a blank inside a line, and not the separator."""
    return is_blank(byte) and not is_end(byte) and (byte == SPACE or byte != text.separator)


cdef inline bint begin_line(Text *text) noexcept nogil:
    """Go to where the next line begins that is neither blank nor a comment; False if none does."""
    cdef unsigned char *at = text.at
    cdef unsigned char byte
    cdef bint comment = False
    while at < text.end:
        byte = at[0]
        if is_end(byte):
            comment = False
            text.line += byte == RETURN or (at - 1)[0] != RETURN
        elif not comment:
            if byte == HASH:
                comment = True
            elif not is_gap(text, byte):
                break
        at += 1
    text.at = at
    return at < text.end


cdef inline bint in_line(Text *text) noexcept nogil:
    """Go to the next field of the line; False where a comment or the line's end is."""
    while is_gap(text, text.at[0]):
        text.at += 1
    if text.at[0] == NUL and text.at >= text.end:
        return False
    return text.at[0] != HASH and not is_end(text.at[0])


cdef void pass_line(Text *text) noexcept nogil:
    """Go to where the line ends."""
    while text.at < text.end and not is_end(text.at[0]):
        text.at += 1


cdef class Lines(Tokens):
    """Take lines apart, as many as there are to be.

    Parameters
    ----------
    line : int
        The line that the text begins in.
    most : int
        Lines that are read at the most; -1 for all.

    Attributes
    ----------
    rows : int
        Lines that were read.
    """

    cdef readonly int64_t rows
    cdef int64_t most

    def __init__(self, int64_t line, int64_t most):
        self.text.line = line
        self.most = most
        self.rows = 0

    @property
    def done(self):
        """Tell whether as many lines were read as there are to be."""
        return self.rows == self.most

    cdef bint begin_row(self) noexcept nogil:
        """Go to the next line of those that are read; False if there is none."""
        return self.rows != self.most and begin_line(&self.text)

    cdef Py_ssize_t used(self, const unsigned char[::1] chunk):
        """Return the bytes of a chunk that were read."""
        return self.text.at - <unsigned char *>&chunk[1]


@cython.final
cdef class Columns(Lines):
    """Take lines apart that have the same columns.

    Parameters
    ----------
    places : sequence of int
        Of each column of a line: where it goes, or -1.
    width : int
        Columns that are wanted.
    separator : bytes
        One byte; a blank where blanks part columns.
    line, most : int
        As for `Lines`.

    Attributes
    ----------
    fault : int
    found : int
        Columns of the line that has others; the column, from 0, of what is no number.
    """

    cdef readonly int fault
    cdef readonly int found
    cdef int columns
    cdef int width
    cdef int places[WIDEST]
    cdef double *out

    def __init__(self, places, int width, bytes separator, int64_t line, int64_t most):
        super().__init__(line, most)
        if len(places) > WIDEST:
            raise ValueError(f"{len(places)} columns: no room for them")
        self.columns = len(places)
        for i, place in enumerate(places):
            self.places[i] = place
        self.width = width
        self.text.separator = separator[0]
        self.fault = self.found = 0

    def parse(self, const unsigned char[::1] chunk not None):
        """Read whole lines, with a byte before and a NUL behind.

        Returns
        -------
        values : (n, width) float64
        used : int
            Bytes.
        """
        cdef double[:, ::1] values
        cdef int64_t before = self.rows
        # A column takes a byte and one that parts it from the next, or is empty.
        owner = np.empty((chunk.shape[0] // max(self.columns, 1) + 1, max(self.width, 1)))
        values = owner
        self.out = &values[0, 0]
        self.take_chunk(chunk)
        with nogil:
            self.run()
        return owner[:self.rows - before, :self.width], self.used(chunk)

    cdef int run(self) except -1 nogil:
        while self.begin_row():
            if self.text.separator == SPACE:
                self.read_blanks()
            else:
                self.read_separated()
            if self.fault:
                break
            self.rows += 1
            self.out += max(self.width, 1)
        return 0

    cdef int read_blanks(self) except -1 nogil:
        """Read a line whose columns blanks part."""
        cdef int column = 0
        while in_line(&self.text):
            if column < self.columns and self.places[column] >= 0:
                if read_any_number(&self.text, self.out + self.places[column]) != FOUND:
                    return self.fail(NO_NUMBER, column)
            else:
                while self.text.at < self.text.end and not is_blank(self.text.at[0]):
                    self.text.at += 1
            column += 1
        return self.end_line(column)

    cdef int read_separated(self) except -1 nogil:
        """Read a line whose columns a separator parts."""
        cdef int column = 0
        while True:
            in_line(&self.text)
            if column < self.columns and self.places[column] >= 0:
                if not self.read_field(self.out + self.places[column]):
                    return self.fail(NO_NUMBER, column)
            else:
                self.pass_field()
            column += 1
            if not in_line(&self.text):
                return self.end_line(column)
            if self.text.at[0] != self.text.separator:
                measure(&self.text)
                return self.fail(NO_NUMBER, column - 1)
            self.text.at += 1

    cdef int end_line(self, int column) noexcept nogil:
        pass_line(&self.text)
        if column != self.columns:
            self.text.length = 0
            return self.fail(OTHER_COLUMNS, column)
        return 0

    cdef bint read_field(self, double *out) except -1 nogil:
        """Read a number, which may be in quotes, or NaN where none is; False for anything else."""
        cdef unsigned char separator = self.text.separator
        cdef bint found
        if self.text.at[0] != QUOTE:
            return self.read_unquoted(out)
        self.text.at += 1
        self.text.separator = QUOTE
        in_line(&self.text)
        found = self.read_unquoted(out)
        in_line(&self.text)
        self.text.separator = separator
        if not found or self.text.at[0] != QUOTE:
            return False
        self.text.at += 1
        return True

    cdef bint read_unquoted(self, double *out) except -1 nogil:
        if self.text.at[0] == self.text.separator or not in_line(&self.text):
            out[0] = NAN
            return True
        return read_any_number(&self.text, out) == FOUND

    cdef void pass_field(self) noexcept nogil:
        """Go to the separator, which is none in quotes, or to the line's end.

        A quote in quotes is two.
        """
        cdef bint begun = self.text.at[0] == QUOTE
        cdef bint quoted = begun
        self.text.at += quoted
        while self.text.at < self.text.end and not is_end(self.text.at[0]):
            if self.text.at[0] == QUOTE and begun:
                quoted = not quoted
            elif self.text.at[0] == self.text.separator and not quoted:
                break
            self.text.at += 1

    cdef int fail(self, int fault, int found) noexcept nogil:
        self.fault = fault
        self.found = found
        return 0


@cython.final
cdef class Ragged(Lines):
    """Take lines apart that have any number of numbers, parted by blanks.

    Attributes
    ----------
    failed : bool
        Whether the last token is no number.
    """

    cdef readonly bint failed
    cdef double *out_values
    cdef uint32_t *out_counts
    cdef int64_t *out_lines
    cdef Py_ssize_t values
    cdef Py_ssize_t counts

    def __init__(self, int64_t line, int64_t most):
        super().__init__(line, most)
        self.failed = False

    def parse(self, const unsigned char[::1] chunk not None):
        """Read whole lines, with a byte before and a NUL behind.

        Returns
        -------
        values : (m,) float64
            The numbers of all, one line after the other.
        counts : (n,) uint32
            Numbers of each line.
        lines : (n,) int64
            Where each is in the text.
        used : int
            Bytes.
        """
        cdef double[::1] values
        cdef uint32_t[::1] counts
        cdef int64_t[::1] lines
        most = chunk.shape[0] // 2 + 1
        values_owner = np.empty(most)
        counts_owner, lines_owner = np.empty(most, np.uint32), np.empty(most, np.int64)
        values, counts, lines = values_owner, counts_owner, lines_owner
        self.out_values, self.out_counts, self.out_lines = &values[0], &counts[0], &lines[0]
        self.values = self.counts = 0
        self.take_chunk(chunk)
        with nogil:
            self.run()
        return (
            values_owner[:self.values], counts_owner[:self.counts], lines_owner[:self.counts],
            self.used(chunk),
        )

    cdef int run(self) except -1 nogil:
        cdef Py_ssize_t before
        while self.begin_row():
            before = self.values
            while in_line(&self.text):
                if read_any_number(&self.text, self.out_values + self.values) != FOUND:
                    self.failed = True
                    return 0
                self.values += 1
            pass_line(&self.text)
            self.out_counts[self.counts] = <uint32_t>(self.values - before)
            self.out_lines[self.counts] = self.text.line
            self.counts += 1
            self.rows += 1
        return 0
