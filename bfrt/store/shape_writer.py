"""Spheres, cones, triangles, patches and polygons as arrays, which become a store's records."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from bfrt.errors import SceneError
from bfrt.records import Kind
from bfrt.store.given import array_of, column_of, faces_among, floats_of, rows_beside, rows_of
from bfrt.store.record_writer import RecordWriter

#: Faces of a mesh that are made objects at once.
FACES_AT_ONCE = 1 << 17


class ShapeWriter(RecordWriter):
    """Takes shapes, block by block, and writes their records."""

    def spheres(
        self,
        centers: ArrayLike,
        radii: ArrayLike,
        materials: ArrayLike | None = None,
        *,
        group: int = 0,
    ) -> None:
        """Add spheres.

        Parameters
        ----------
        centers : (n, 3) array_like
            World coordinates. Float32 stays float32; all other numbers are taken as float64.
        radii : float or (n,) array_like
            World units, converted to the type of `centers`. A negative radius turns the normal
            inwards; a sphere of radius 0 is kept and never hit.
        materials : int or (n,) array_like of int, optional
            Indices that `material` returned. By default a plain `Material`.
        group : int
            The group that the objects belong to; each group has a grid of its own. Groups are
            numbered from 0 without gaps: an old one, or the next.

        Raises
        ------
        SceneError
            If shapes do not fit, a number is not finite, or a material does not exist.
        SettingError
            If `group` is beyond the next, or the writer is closed.
        DiskFullError, StreamError
            If the system refuses a write.
        """
        c, n = rows_of("centers", centers, (3,))
        records = np.hstack([c, column_of("radii", radii, n, c.dtype)])
        self.append(Kind.SPHERE, records, materials, group=group)

    def cones(
        self,
        bases: ArrayLike,
        base_radii: ArrayLike,
        apexes: ArrayLike,
        apex_radii: ArrayLike,
        materials: ArrayLike | None = None,
        *,
        group: int = 0,
    ) -> None:
        """Add cones and cylinders without caps.

        Parameters
        ----------
        bases, apexes : (n, 3) array_like
            The centers of both ends, world coordinates. If both are float32 they stay so; else
            both are taken as float64.
        base_radii, apex_radii : float or (n,) array_like
            The radii at the ends, world units. Equal radii make a cylinder, and 0 a tip. Negative
            radii turn the normals inwards; the two of a cone have one sign.
        materials, group
            As for `spheres`.

        Raises
        ------
        SceneError, SettingError, DiskFullError, StreamError
            As for `spheres`; SceneError for a cone that has radii of both signs, too.
        """
        a, n = rows_of("bases", bases, (3,))
        b = rows_beside("apexes", apexes, (3,), n, "bases")
        dtype = np.result_type(a, b)
        ra = column_of("base_radii", base_radii, n, dtype)
        rb = column_of("apex_radii", apex_radii, n, dtype)
        if (ra * rb < 0).any():
            raise SceneError("cones: found radii of both signs in one cone, expected one sign")
        self.append(Kind.CONE, np.hstack([a, ra, b, rb]), materials, group=group)

    def triangles(
        self, vertices: ArrayLike, materials: ArrayLike | None = None, *, group: int = 0
    ) -> None:
        """Add triangles.

        Parameters
        ----------
        vertices : (n, 3, 3) array_like
            Three corners of each, world coordinates, counterclockwise seen from outside. Float32
            stays float32; all other numbers are taken as float64.
        materials, group
            As for `spheres`.

        Raises
        ------
        SceneError, SettingError, DiskFullError, StreamError
            As for `spheres`.
        """
        v, n = rows_of("vertices", vertices, (3, 3))
        self.append(Kind.TRIANGLE, v.reshape(n, 9), materials, group=group)

    def patches(
        self,
        vertices: ArrayLike,
        normals: ArrayLike,
        materials: ArrayLike | None = None,
        *,
        group: int = 0,
    ) -> None:
        """Add patches: triangles with a normal at each corner, for smooth shading.

        Parameters
        ----------
        vertices : (n, 3, 3) array_like
            Three corners of each, world coordinates, counterclockwise seen from outside.
        normals : (n, 3, 3) array_like
            The normal at each corner, of any length. Both stay float32 if both are; else both are
            taken as float64.
        materials, group
            As for `spheres`.

        Raises
        ------
        SceneError, SettingError, DiskFullError, StreamError
            As for `spheres`.
        """
        v, n = rows_of("vertices", vertices, (3, 3))
        own = rows_beside("normals", normals, (3, 3), n, "vertices")
        records = np.hstack([v.reshape(n, 9), own.reshape(n, 9)])
        self.append(Kind.PATCH, records, materials, group=group)

    def mesh(
        self,
        vertices: ArrayLike,
        faces: ArrayLike,
        normals: ArrayLike | None = None,
        materials: ArrayLike | None = None,
        *,
        group: int = 0,
    ) -> None:
        """Add triangles that share vertices, or patches, where vertices have normals.

        Parameters
        ----------
        vertices : (v, 3) array_like
            World coordinates. Float32 stays float32; all other numbers are taken as float64.
        faces : (n, 3) array_like of int
            The vertices of each triangle, from 0, counterclockwise seen from outside.
        normals : (v, 3) array_like, optional
            The normal at each vertex, of any length, which makes patches. One of zeros is none:
            the others of a face count alone, and where they cancel the face's own.
        materials, group
            As for `spheres`: one for each face.

        Raises
        ------
        SceneError, SettingError, DiskFullError, StreamError
            As for `spheres`; SceneError for a face of a vertex that is not there, too.
        """
        v, n = rows_of("vertices", vertices, (3,))
        corners = faces_among(faces, n)
        indices = self._material_indices(materials, len(corners))
        kind = Kind.TRIANGLE
        if normals is not None:
            v = np.hstack([v, rows_beside("normals", normals, (3,), n, "vertices")])
            kind = Kind.PATCH
        for first in range(0, len(corners), FACES_AT_ONCE):
            part = slice(first, first + FACES_AT_ONCE)
            own = v.take(corners[part], axis=0).reshape(-1, 3, v.shape[1] // 3, 3)
            records = own.swapaxes(1, 2).reshape(len(own), -1)
            self.append(kind, records, indices[part], group=group)

    def polygons(
        self,
        vertices: ArrayLike,
        counts: ArrayLike,
        materials: ArrayLike | None = None,
        *,
        group: int = 0,
    ) -> None:
        """Add polygons, convex or concave.

        A polygon of three vertices is stored as a triangle and numbered among triangles. A polygon
        is met in the plane that fits its vertices.

        Parameters
        ----------
        vertices : (m, 3) array_like
            The vertices of all polygons, one polygon after another, world coordinates,
            counterclockwise seen from outside. Float32 stays float32; all other numbers are taken
            as float64.
        counts : (n,) array_like of int
            Number of vertices of each polygon, 3 or more; they add up to m.
        materials, group
            As for `spheres`.

        Raises
        ------
        SceneError, SettingError, DiskFullError, StreamError
            As for `spheres`; SceneError for counts that do not fit, too.
        """
        given = floats_of("vertices", vertices), array_of("counts", counts)
        self.append_polygons(*given, materials, group=group)
