"""The loop of the NFF reader: text in chunks to records in blocks, without the GIL.

::

    feed(chunk) --> [ previous byte | unfinished token | chunk | NUL ]
                                         |
    advance()     find a blank's end, a token --> number / integer / keyword
                                         |
                     value[] --> commit --> block of a kind --> Event.BLOCK_FULL --> take(kind)

A chunk may end anywhere. Nothing is consumed of a token that may go on in the next chunk; ``feed``
carries it over, which is at most ``MAX_TOKEN`` bytes. The state of the entity that is being read
(`entity`, `have`, `need`) lives in the parser, so that ``advance`` goes on where it stopped.

``nff.py`` decides what an event means and words the errors.
"""

cimport cython
from libc.math cimport INFINITY
from libc.stdint cimport int64_t, uint32_t
from libc.string cimport memcmp, memcpy, memmove

from bfrt.formats.text cimport (
    ENDLESS, FOUND, MINUS, MOST_CORNERS, NEWLINE, NOT_ASCII, NO_FINITE, NO_INTEGER, NO_NUMBER, NUL,
    PLUS, POINT, RETURN, SPACE, STARVED, TOKEN_BYTES, Text, Tokens, consume, find_token, measure,
    pass_blanks, read_integer, read_number,
)
from bfrt.records cimport KINDS

import numpy as np

from bfrt.records import SCALARS, Kind

cpdef enum Event:
    HUNGRY  # the chunk is used up
    DONE  # the text has ended well
    FAULT  # `fault`, `line` and `token` say what and where
    CAMERA  # `view` is complete
    LIGHT  # `values` has 3 or 6 numbers
    BACKGROUND  # `values` has 3
    MATERIAL  # `values` has 8
    UNPAINTED  # an object comes before the first material
    BLOCK_FULL  # the block of `kind` wants to be taken

cpdef enum Fault:
    CUT_SHORT = 1
    BINARY = NOT_ASCII
    TOO_LONG = ENDLESS
    NOT_A_NUMBER = NO_NUMBER
    NOT_FINITE = NO_FINITE
    NOT_AN_INTEGER = NO_INTEGER
    NEGATIVE
    MIXED_RADII
    UNKNOWN_KEYWORD
    SECOND_VIEW
    SECOND_FIELD
    MISSING_FIELD

# What the next numbers are. Up to VIEW_RESOLUTION the order is that of the bits of `seen`.
cpdef enum Entity:
    VIEW_FROM
    VIEW_AT
    VIEW_UP
    VIEW_ANGLE
    VIEW_HITHER
    VIEW_RESOLUTION
    BACKGROUND_COLOR
    LIGHT_POSITION
    LIGHT_COLOR
    MATERIAL_COLOR
    MATERIAL_REST
    SPHERE
    CONE
    POLYGON_COUNT
    TRIANGLE
    POLYGON_VERTEX
    PATCH_COUNT
    PATCH_VERTEX

cdef enum:
    RECENT = 16  # materials that are found again at once

cdef enum:
    RESOLUTION_LIMIT = 65535
    # What a step of the loop ends with, if not with an Event.
    GO_ON = -3
    GROW = -4

MAX_TOKEN = TOKEN_BYTES
MAX_RESOLUTION = RESOLUTION_LIMIT

cdef int SPHERES = Kind.SPHERE
cdef int CONES = Kind.CONE
cdef int TRIANGLES = Kind.TRIANGLE
cdef int PATCHES = Kind.PATCH
cdef int POLYGONS = Kind.POLYGON

cdef unsigned int REQUIRED = 0x3F & ~(1u << VIEW_HITHER)
cdef const char *VIEW_NAMES[6]
VIEW_NAMES[:] = [b"from", b"at", b"up", b"angle", b"hither", b"resolution"]
cdef int VIEW_LENGTHS[6]
VIEW_LENGTHS[:] = [4, 2, 2, 5, 6, 10]
cdef int VIEW_NUMBERS[6]
VIEW_NUMBERS[:] = [3, 3, 3, 1, 1, 2]
cdef int VIEW_PLACES[6]
VIEW_PLACES[:] = [0, 3, 6, 9, 10, 11]

cdef struct Block:
    double *records
    uint32_t *materials
    Py_ssize_t count
    Py_ssize_t scalars


@cython.final
cdef class Parser(Tokens):
    """Parses NFF text into events and blocks of records.

    Parameters
    ----------
    chunk_bytes : int
        The most that one ``feed`` may bring.
    block_objects : int
        Objects of a kind in a block.
    """

    cdef Block blocks[KINDS]
    cdef int64_t *polygon_counts
    cdef Py_ssize_t vertices  # in the polygon block, those of an unfinished polygon too
    cdef Py_ssize_t vertex_capacity
    cdef Py_ssize_t block_objects
    cdef Py_ssize_t block_vertices
    cdef Py_ssize_t chunk_bytes

    cdef double value[9]
    cdef double view_values[13]
    cdef double fan[12]  # the first and the last vertex of a patch, each with its normal
    cdef int need  # 0: a keyword comes
    cdef double floor  # the least value allowed
    cdef int64_t promised  # vertices of the polygon or patch
    cdef bint viewed  # there was a v
    cdef bint in_view  # its fields may yet come
    cdef bint in_light  # a light that may yet have a color
    cdef bint painted
    cdef uint32_t paint
    cdef double recent[RECENT][8]  # the last materials, and their palette indices
    cdef uint32_t recent_paint[RECENT]
    cdef int paints  # how many there have been

    cdef readonly int have
    cdef readonly int entity
    cdef readonly int64_t vertex  # vertices read of the polygon or patch
    cdef readonly unsigned int seen  # a bit for each field of the view
    cdef readonly int64_t view_line
    cdef readonly int fault
    cdef readonly int kind

    cdef object text_owner
    cdef object polygon_owner
    cdef list record_owners
    cdef list material_owners

    def __init__(self, Py_ssize_t chunk_bytes, Py_ssize_t block_objects):
        if chunk_bytes < 1 or block_objects < 1:
            raise ValueError("chunk_bytes and block_objects must be positive")
        self.chunk_bytes = chunk_bytes
        self.block_objects = block_objects
        self.block_vertices = 4 * block_objects
        self._own_text()
        self._own_blocks()
        self.need = 0
        self.floor = -INFINITY
        self.text.ended = False
        self.in_view = self.in_light = self.painted = self.viewed = False
        self.seen = 0
        self.vertex = self.promised = self.vertices = self.paints = 0

    def _own_text(self):
        cdef unsigned char[::1] buffer
        self.text_owner = np.zeros(1 + TOKEN_BYTES + self.chunk_bytes + 1, dtype=np.uint8)
        buffer = self.text_owner
        buffer[0] = SPACE
        self.text.at = self.text.end = self.text.token = &buffer[1]
        self.text.length = 0

    def _own_blocks(self):
        cdef double[:, ::1] records
        cdef uint32_t[::1] materials
        cdef int64_t[::1] counts
        n = self.block_objects
        self.record_owners = [
            np.empty((self.block_vertices if kind is Kind.POLYGON else n, SCALARS[kind]))
            for kind in Kind
        ]
        self.material_owners = [np.empty(n, dtype=np.uint32) for _ in Kind]
        self.polygon_owner = np.empty(n, dtype=np.int64)
        self.vertex_capacity = self.block_vertices
        for kind in Kind:
            records = self.record_owners[kind]
            materials = self.material_owners[kind]
            self.blocks[<int>kind] = Block(
                &records[0, 0], &materials[0], 0, records.shape[1]
            )
        counts = self.polygon_owner
        self.polygon_counts = &counts[0]

    # --- what nff.py calls

    def feed(self, const unsigned char[::1] chunk not None):
        """Take the next chunk; the last one, if it is empty. ``advance`` must have been HUNGRY."""
        cdef Text *text = &self.text
        cdef unsigned char[::1] buffer = self.text_owner
        cdef Py_ssize_t left = text.end - text.at
        cdef Py_ssize_t size = chunk.shape[0]
        if left > TOKEN_BYTES or size > self.chunk_bytes:
            raise ValueError(f"a chunk of {size} bytes, {left} unread: no room for it")
        memmove(&buffer[0], text.at - 1, left + 1)
        if size:
            memcpy(&buffer[1 + left], &chunk[0], size)
        else:
            text.ended = True
        text.at = &buffer[1]
        text.end = text.at + left + size
        text.end[0] = NUL
        if text.comment:
            pass_blanks(text)

    def advance(self):
        """Read on to the next event."""
        cdef int event = GROW
        while event == GROW:
            with nogil:
                event = self.run()
            if event == GROW:
                self._grow()
        return event

    def paint_with(self, uint32_t material):
        """Give the objects from here on this palette index."""
        cdef int place = self.paints % RECENT
        self.paint = material
        self.painted = True
        if self.entity == MATERIAL_REST:
            memcpy(&self.recent[place][0], self.value, 8 * sizeof(double))
            self.recent_paint[place] = material
            self.paints += 1

    cdef bint paint_again(self) noexcept nogil:
        """Take the index of the material if it is one of the last few; tell whether it is."""
        cdef int i
        for i in range(min(self.paints, RECENT)):
            if memcmp(&self.recent[i][0], self.value, 8 * sizeof(double)) == 0:
                self.paint = self.recent_paint[i]
                return True
        return False

    def take(self, kind):
        """Return a kind's block, (records, materials), which the next ``advance`` overwrites."""
        cdef Block *block = &self.blocks[<int>kind]
        cdef Py_ssize_t count = block.count
        block.count = 0
        return self.record_owners[kind][:count], self.material_owners[kind][:count]

    def take_polygons(self):
        """Return the block of polygons: (vertices, counts, materials)."""
        cdef Block *block = &self.blocks[POLYGONS]
        cdef Py_ssize_t count = block.count
        cdef Py_ssize_t vertices = self.vertices
        block.count = self.vertices = 0
        return (
            self.record_owners[POLYGONS][:vertices],
            self.polygon_owner[:count],
            self.material_owners[POLYGONS][:count],
        )

    @property
    def values(self):
        """Return the numbers of the entity that the last event is about."""
        return tuple([self.value[i] for i in range(self.have)])

    @property
    def view(self):
        """Return the view's 13 numbers: from, at, up, angle, hither, resolution."""
        return tuple([self.view_values[i] for i in range(13)])

    @property
    def awaits_number(self):
        """Tell whether a number of `entity` comes next, after `have` others, or else a keyword."""
        return self.need > 0

    def _grow(self):
        """Double the room for vertices, which grows only with vertices that the file contains."""
        cdef double[:, ::1] records
        wider = np.empty((2 * self.vertex_capacity, 3))
        wider[:self.vertices] = self.record_owners[POLYGONS][:self.vertices]
        self.record_owners[POLYGONS] = wider
        records = wider
        self.blocks[POLYGONS].records = &records[0, 0]
        self.vertex_capacity *= 2

    # --- the loop

    cdef int run(self) except -1 nogil:
        cdef int event = GO_ON
        while event == GO_ON:
            event = self.read_numbers() if self.need else self.read_keyword()
        return event

    cdef int fail(self, int fault) noexcept nogil:
        self.fault = fault
        return FAULT

    cdef int answer(self, int status) noexcept nogil:
        """Return the event for a token that was not FOUND."""
        return HUNGRY if status == STARVED else self.fail(status)

    cdef int run_dry(self, int fault) noexcept nogil:
        """Return the event for a text that ends where a token is due."""
        cdef unsigned char before = (self.text.at - 1)[0]
        if not self.text.ended:
            return HUNGRY
        self.text.length = 0
        # Behind a line's end there is no further line to point at.
        if before == NEWLINE or before == RETURN:
            self.text.line -= 1
        return self.fail(fault)

    cdef int begin(self, int entity, int have, int need, double floor) noexcept nogil:
        self.entity = entity
        self.have = have
        self.need = need
        self.floor = floor
        return GO_ON

    cdef int read_numbers(self) except -1 nogil:
        cdef int status
        cdef double x
        while self.have < self.need:
            if not find_token(&self.text):
                return self.run_dry(CUT_SHORT)
            if self.entity == POLYGON_COUNT or self.entity == PATCH_COUNT:
                status = read_integer(&self.text, 3, MOST_CORNERS, &x)
            elif self.entity == VIEW_RESOLUTION:
                status = read_integer(&self.text, 1, RESOLUTION_LIMIT, &x)
            else:
                status = read_number(&self.text, &x)
            if status != FOUND:
                return self.answer(status)
            if x < self.floor:
                return self.fail(NEGATIVE)
            self.value[self.have] = x
            self.have += 1
        self.need = 0
        return self.commit()

    cdef int commit(self) noexcept nogil:
        """Store an entity whose numbers are complete."""
        if self.entity == SPHERE:
            return self.append(SPHERES, self.value)
        if self.entity == CONE:
            if self.signs_differ():
                return self.fail(MIXED_RADII)
            return self.append(CONES, self.value)
        if self.entity == TRIANGLE:
            return self.append(TRIANGLES, self.value)
        if self.entity == POLYGON_VERTEX:
            return self.add_vertex()
        if self.entity == PATCH_VERTEX:
            return self.add_corner()
        if self.entity == POLYGON_COUNT or self.entity == PATCH_COUNT:
            return self.begin_vertices()
        return self.commit_setting()

    cdef bint signs_differ(self) noexcept nogil:
        return (self.value[3] < 0 < self.value[7]) or (self.value[7] < 0 < self.value[3])

    cdef int commit_setting(self) noexcept nogil:
        if self.entity <= VIEW_RESOLUTION:
            memcpy(
                &self.view_values[VIEW_PLACES[self.entity]],
                self.value,
                self.have * sizeof(double),
            )
            return GO_ON
        if self.entity == LIGHT_POSITION:
            self.in_light = True
            return GO_ON
        if self.entity == MATERIAL_COLOR:
            return self.begin(MATERIAL_REST, 3, 8, 0.0)
        if self.entity == LIGHT_COLOR:
            return LIGHT
        if self.entity == MATERIAL_REST:
            return GO_ON if self.paint_again() else MATERIAL
        return BACKGROUND

    cdef int append(self, int kind, const double *record) noexcept nogil:
        cdef Block *block = &self.blocks[kind]
        memcpy(
            block.records + block.count * block.scalars, record, block.scalars * sizeof(double)
        )
        block.materials[block.count] = self.paint
        block.count += 1
        if block.count < self.block_objects:
            return GO_ON
        self.kind = kind
        return BLOCK_FULL

    cdef int begin_vertices(self) noexcept nogil:
        self.promised = <int64_t>self.value[0]
        self.vertex = 0
        if self.entity == PATCH_COUNT:
            return self.begin(PATCH_VERTEX, 0, 6, -INFINITY)
        if self.promised == 3:
            return self.begin(TRIANGLE, 0, 9, -INFINITY)
        return self.begin(POLYGON_VERTEX, 0, 3, -INFINITY)

    cdef int add_vertex(self) noexcept nogil:
        cdef Block *block = &self.blocks[POLYGONS]
        memcpy(block.records + 3 * self.vertices, self.value, 3 * sizeof(double))
        self.vertices += 1
        self.vertex += 1
        if self.vertex < self.promised:
            self.begin(POLYGON_VERTEX, 0, 3, -INFINITY)
            return GROW if self.vertices == self.vertex_capacity else GO_ON
        block.materials[block.count] = self.paint
        self.polygon_counts[block.count] = self.promised
        block.count += 1
        if block.count < self.block_objects and self.vertices < self.block_vertices:
            return GO_ON
        self.kind = POLYGONS
        return BLOCK_FULL

    cdef int add_corner(self) noexcept nogil:
        """Add a corner; from the third on it makes a patch with the first and the previous one."""
        cdef double record[18]
        cdef int event = GO_ON
        cdef int i
        if self.vertex >= 2:
            for i in range(3):
                record[i] = self.fan[i]
                record[3 + i] = self.fan[6 + i]
                record[6 + i] = self.value[i]
                record[9 + i] = self.fan[3 + i]
                record[12 + i] = self.fan[9 + i]
                record[15 + i] = self.value[3 + i]
            event = self.append(PATCHES, record)
        memcpy(&self.fan[0 if self.vertex == 0 else 6], self.value, 6 * sizeof(double))
        self.vertex += 1
        if self.vertex < self.promised:
            self.begin(PATCH_VERTEX, 0, 6, -INFINITY)
        return event

    cdef int read_keyword(self) noexcept nogil:
        cdef int status
        cdef int field
        if not find_token(&self.text):
            return self.end_text()
        status = measure(&self.text)
        if status != FOUND:
            return self.answer(status)
        if self.in_light:
            return self.end_light()
        if self.in_view:
            field = self.view_field()
            return self.end_view() if field < 0 else self.begin_field(field)
        return self.begin_entity()

    cdef int end_text(self) noexcept nogil:
        if not self.text.ended:
            return HUNGRY
        if self.in_light:
            self.in_light = False
            return LIGHT
        if self.in_view:
            if self.seen & REQUIRED != REQUIRED:
                return self.run_dry(MISSING_FIELD)
            self.in_view = False
            return CAMERA
        return DONE

    cdef int end_light(self) noexcept nogil:
        """End a light's position; a number that follows is its color."""
        cdef unsigned char byte = self.text.token[0]
        self.in_light = False
        if 48 <= byte <= 57 or byte == PLUS or byte == MINUS or byte == POINT:
            return self.begin(LIGHT_COLOR, 3, 6, 0.0)
        return LIGHT

    cdef int end_view(self) noexcept nogil:
        if self.seen & REQUIRED != REQUIRED:
            return self.fail(MISSING_FIELD)
        self.in_view = False
        return CAMERA

    cdef int view_field(self) noexcept nogil:
        """Return the index of the view's field that the token names; -1 if none."""
        cdef int field
        for field in range(6):
            if (
                self.text.length == VIEW_LENGTHS[field]
                and memcmp(self.text.token, VIEW_NAMES[field], VIEW_LENGTHS[field]) == 0
            ):
                return field
        return -1

    cdef int begin_field(self, int field) noexcept nogil:
        if self.seen & (1u << field):
            return self.fail(SECOND_FIELD)
        self.seen |= 1u << field
        consume(&self.text)
        return self.begin(field, 0, VIEW_NUMBERS[field], -INFINITY)

    cdef int begin_entity(self) noexcept nogil:
        cdef unsigned char first = self.text.token[0]
        cdef bint twice = self.text.length == 2 and first == b"p" and self.text.token[1] == b"p"
        if self.text.length != 1 and not twice:
            return self.fail(UNKNOWN_KEYWORD)
        if first == b"v":
            return self.begin_view()
        if first == b"b":
            consume(&self.text)
            return self.begin(BACKGROUND_COLOR, 0, 3, 0.0)
        if first == b"l":
            consume(&self.text)
            return self.begin(LIGHT_POSITION, 0, 3, -INFINITY)
        if first == b"f":
            consume(&self.text)
            return self.begin(MATERIAL_COLOR, 0, 3, 0.0)
        return self.begin_object(first, twice)

    cdef int begin_view(self) noexcept nogil:
        if self.viewed:
            return self.fail(SECOND_VIEW)
        self.viewed = self.in_view = True
        self.view_line = self.text.line
        consume(&self.text)
        return GO_ON

    cdef int begin_object(self, unsigned char first, bint twice) noexcept nogil:
        if first != b"c" and first != b"s" and first != b"p":
            return self.fail(UNKNOWN_KEYWORD)
        if not self.painted:
            return UNPAINTED
        consume(&self.text)
        if first == b"c":
            return self.begin(CONE, 0, 8, -INFINITY)
        if first == b"s":
            return self.begin(SPHERE, 0, 4, -INFINITY)
        return self.begin(PATCH_COUNT if twice else POLYGON_COUNT, 0, 1, -INFINITY)
