"""What parsers of text have in common; the loops over it are in ``text.pxd``."""


cdef class Tokens:
    """A text that is read token by token, and where it is.

    A parser begins before its first chunk; it takes chunks of whole tokens, unless it carries over
    by itself what a chunk ends with, as NFF's does.
    """

    def __cinit__(self):
        self.text.line = 1
        self.text.ended = True  # no token goes on in the next chunk
        self.text.comment = False
        self.text.length = 0

    @property
    def line(self):
        """The line of the last token."""
        return self.text.line

    @property
    def token(self):
        """The last token, empty at the end of the file."""
        return self.text.token[:self.text.length]

    cdef void take_chunk(self, const unsigned char[::1] chunk):
        """Go to the begin of a chunk, which has a byte before it and a NUL behind."""
        self.text.at = self.text.token = <unsigned char *>&chunk[1]
        self.text.end = <unsigned char *>&chunk[chunk.shape[0] - 1]
        self.text.length = 0
        if self.text.comment:
            pass_blanks(&self.text)
