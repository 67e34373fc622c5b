"""What a scene, a picture and a render's progress show in a notebook."""

from __future__ import annotations

import base64
import importlib.util
import re
import sys
from dataclasses import replace

import numpy as np
import pytest
from sharded_scenes import both

import bfrt
from bfrt.errors import SettingError
from bfrt.image.png import encode_srgb
from bfrt.notebook import html_of
from bfrt.progress import Bar, Progress

SMALL = {"memory": "160MiB", "threads": 1}


@pytest.fixture
def scene(tmp_path):
    rng = np.random.default_rng(4)
    with bfrt.SceneWriter(tmp_path / "a <b>.bfrt", order="spatial") as writer:
        writer.camera(bfrt.Camera((6, -5, 4), (0, 0, 0), resolution=(300, 100)))
        writer.light(bfrt.Light((4, 4, 9)))
        mirror = writer.material(bfrt.Material(ks=0.5))
        writer.spheres(rng.uniform(-2, 2, (1200, 3)), 0.3, mirror)
        writer.triangles(rng.uniform(-1, 1, (5, 3, 3)).astype(np.float32), group=1)
    return bfrt.open(writer.path)


def cells(html):
    return re.findall(r"<td[^>]*>([^<]*)</td>", html)


def test_a_scene_shows_what_it_holds(scene):
    html = scene._repr_html_()
    found = cells(html)
    assert "a &lt;b&gt;.bfrt" in html and "<b>.bfrt" not in html
    for name, value in (
        ("objects", "1,205"),
        ("bytes", f"{scene.bytes:,}"),
        ("least", " ".join(f"{x:.12g}" for x in scene.bounds.lo)),
        ("greatest", " ".join(f"{x:.12g}" for x in scene.bounds.hi)),
        ("camera", "its own"),
        ("lights", "1"),
    ):
        assert found[found.index(name) + 1] == value
    head = found.index("group")
    assert found[head : head + 6] == ["group", "kind", "objects", "dtype", "order", "bytes"]
    assert found[head + 6 : head + 11] == ["0", "sphere", "1,200", "float64", "spatial"]
    assert found[head + 12 : head + 16] == ["1", "triangle", "5", "float64"]


def test_a_scene_of_nothing(tmp_path):
    with bfrt.SceneWriter(tmp_path / "a.bfrt") as writer:
        writer.crs("EPSG:32632")
    found = cells(html_of(bfrt.open(writer.path).store))
    assert found[found.index("bounds") + 1] == "none"
    assert found[found.index("camera") + 1] == "none: it is framed"
    assert found[found.index("reference system") + 1] == "EPSG:32632"


def test_the_colors_of_a_scene(tmp_path):
    (tmp_path / "a.csv").write_text("x,y,z,heat\n0,0,0,1\n1,0,0,10\n")
    scene = bfrt.convert(tmp_path / "a.csv", tmp_path / "a.bfrt", radius=1, color_by="heat")
    assert "heat: 1 to 10, viridis" in scene._repr_html_()


@pytest.mark.parametrize(
    ("pixels", "size"), [(30, (30, 10)), (256, (256, 85)), (1, (1, 1)), (600, (600, 200))]
)
def test_a_preview_is_small(scene, pixels, size):
    image = scene.preview(pixels)
    assert (image.width, image.height) == size
    camera = replace(scene.camera, resolution=size)
    expected = scene.render(camera=camera, depth=1, **SMALL)
    assert image.rgb.tobytes() == expected.rgb.tobytes()
    assert expected.stats.total.rays.reflection == 0


def test_a_preview_of_a_view(scene):
    camera = bfrt.Camera((0, 9, 1), (0, 0, 0), resolution=(50, 100))
    assert scene.preview(40, camera).shape == (40, 20)
    with pytest.raises(SettingError, match="camera: found list, expected a Camera or None"):
        scene.preview(40, [camera, camera])
    for pixels in (0, 65536, 2.5):
        with pytest.raises(SettingError, match="pixels: found"):
            scene.preview(pixels)


@pytest.mark.skipif(importlib.util.find_spec("matplotlib") is None, reason="needs matplotlib")
def test_a_picture_is_plotted_as_its_png(scene):
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    image = scene.preview(40)
    axes = image.plot()
    (shown,) = axes.images
    np.testing.assert_array_equal(np.asarray(shown.get_array()), encode_srgb(image.rgb))
    np.testing.assert_array_equal(image.srgb(), encode_srgb(image.rgb))
    assert image.plot(axes) is axes and len(axes.images) == 2
    with pytest.raises(SettingError, match="axes: found int, expected axes of matplotlib"):
        image.plot(3)
    pyplot.close("all")


def test_a_plot_without_matplotlib(scene, monkeypatch):
    image = scene.preview(8)
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(SettingError) as caught:
        image.plot()
    assert str(caught.value) == "image: a plot needs matplotlib: pip install bfrt[colormaps]"


def test_several_pictures_show_themselves(scene):
    views = scene.turntable(2, replace(scene.camera, resolution=(6, 4)))
    images = scene.render(camera=views, **SMALL)
    assert images[:1]._repr_html_() in images._repr_html_()
    assert images[-1] is images[1] and images[::2].stats is images.stats
    found = re.findall(r'<img src="data:image/png;base64,([^"]*)">', images._repr_html_())
    assert [base64.b64decode(each) for each in found] == [image._repr_png_() for image in images]


def test_a_sharded_scene_shows_itself(tmp_path):
    pytest.importorskip("distributed", reason="needs dask and distributed")
    from cluster_fixtures import cluster_of

    scene = both(tmp_path / "s", 2)
    with cluster_of(1, processes=False) as client:
        far = bfrt.open(scene.sharded.path, client=client)
        found = cells(far._repr_html_())
    assert found[found.index("shards") + 1] == "2"
    assert found[found.index("objects") + 1] == f"{scene.one.objects:,}"
    assert "2 shards" in found


class Shown(list):
    """Notes how bars are made."""

    def base(self, notebook):
        shown = self

        class Noted(notebook or object):
            def __init__(self, **asked):
                shown.append(asked)
                self.n = 0

            def update(self, n):
                self.n += n

            def close(self):
                shown.append("closed")

        return Noted


@pytest.mark.parametrize("in_notebook", [False, True])
def test_a_bar_is_the_notebooks_in_one(monkeypatch, in_notebook):
    auto = pytest.importorskip("tqdm.auto")
    from tqdm.notebook import tqdm_notebook

    shown = Shown()
    monkeypatch.setattr(auto, "tqdm", shown.base(tqdm_notebook if in_notebook else None))
    with Bar() as bar:
        bar.show(Progress(1, 0, 10))
        bar.show(Progress(1, 10, 10))
        bar.show(Progress(2, 0, 5))
    asked = [each for each in shown if each != "closed"]
    assert [each["desc"] for each in asked] == ["depth 1", "depth 2"]
    assert all(each["disable"] is (False if in_notebook else None) for each in asked)
    assert shown.count("closed") >= 2  # tqdm's own closes itself again
