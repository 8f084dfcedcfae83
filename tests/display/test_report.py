"""The report: one page that stands on its own, and works in a browser."""

import base64
import io
import json
import re
import shutil
import subprocess
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from relight3d.display.report import report
from relight3d.errors import InputError
from relight3d.evaluate.run import evaluate
from relight3d.records import Capture, RelightModel

CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")
QUIET = "quic background-networking component-update sync gpu"  # nothing that asks the network
FLAGS = ["--headless", "--no-sandbox", "--no-first-run", *(f"--disable-{word}" for word in QUIET.split(" "))]
FLAGS += ["--enable-logging=stderr", "--virtual-time-budget=4000"]
VOID = {"meta", "link", "img", "input", "br", "circle"}
# Moves every slider by hand, looks at the page at a phone's width, and leaves what it saw for --dump-dom.
PROBE = """
<script>
const seen = {sliders: [], broken: [], wide: 0};
for (const input of document.querySelectorAll('.compare input')) {
  const relit = input.parentElement.querySelector('.relit');
  const places = ['10', '90'].map(value => {
    input.value = value; input.dispatchEvent(new Event('input'));
    return [getComputedStyle(relit).clipPath, input.parentElement.querySelector('.bar').offsetLeft];
  });
  seen.sliders.push(places);
}
window.addEventListener('load', () => {
  for (const image of document.images) if (!image.naturalWidth) seen.broken.push(image.alt);
  const phone = document.createElement('iframe');
  phone.style.width = '390px'; phone.style.height = '800px';
  phone.srcdoc = '<!doctype html>' + document.documentElement.outerHTML.replace(/<script[^]*?<\\/script>/g, '');
  phone.onload = () => {
    seen.wide = phone.contentDocument.documentElement.scrollWidth;
    const text = document.createElement('pre');
    text.id = 'seen'; text.textContent = JSON.stringify(seen); document.body.append(text);
  };
  document.body.append(phone);
});
</script>
"""


class Page(HTMLParser):
    """What a page is made of: addresses, identifiers, links, text; fails on tags that do not close."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.addresses: list[str] = []
        self.ids: set[str] = set()
        self.links: list[str] = []
        self.words = ""
        self.feed(text)
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list) -> None:
        if tag not in VOID:
            self.open.append(tag)
        for name, value in attrs:
            if name in ("src", "href"):
                (self.links if tag == "a" else self.addresses).append(value)
            if name == "id":
                assert value not in self.ids
                self.ids.add(value)

    def handle_endtag(self, tag: str) -> None:
        if tag not in VOID:
            assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.words += data


@pytest.fixture(scope="module")
def path(model: RelightModel, capture: Capture, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("report")
    (folder / "study").mkdir()
    Image.new("RGB", (20, 10), "red").save(folder / "study" / "error_against_time.png")
    return report(model, capture, folder)


@pytest.fixture(scope="module")
def page(path: Path) -> Page:
    return Page(path.read_text("utf-8"))


def test_it_needs_no_other_file_and_no_network(path: Path, page: Page):
    assert path.name == "index.html" and path.stat().st_size < 3e6
    assert page.addresses and all(address.startswith("data:image/") for address in page.addresses)
    assert not re.search(r"url\(|@import|https?://(?!www\.w3\.org)", path.read_text("utf-8"))


def test_every_picture_can_be_opened(page: Page):
    for address in page.addresses:
        kind, _, data = address.partition(";base64,")
        if "svg" not in kind:
            assert np.asarray(Image.open(io.BytesIO(base64.b64decode(data)))).size > 0


def test_every_link_leads_somewhere(page: Page):
    assert page.links and all(link[1:] in page.ids for link in page.links)


def test_it_says_what_there_is_to_say(page: Page, model: RelightModel, capture: Capture):
    found = evaluate(model, capture)
    wanted = [
        f"{found.model.mean.psnr_db:.1f}",
        "RBF",
        "a warning",
        "n 30",
        "error against time",
        "no data",
        "the nearest face",
    ]
    wanted += [photograph.name for photograph in capture.split("test")] + list(model.surfaces.names)
    for words in wanted:
        assert words in page.words, words


def test_a_capture_that_holds_nothing_out_still_has_a_report(model: RelightModel, capture: Capture, tmp_path: Path):
    training = replace(capture, photographs=capture.split("train"))
    page = Page(report(model, training, tmp_path).read_text("utf-8"))
    assert "holds nothing out" in page.words and "metrics" not in page.ids


def test_another_captures_report_is_refused_before_anything_is_written(model, capture: Capture, tmp_path: Path):
    other = replace(capture, photographs=capture.photographs[1:])
    with pytest.raises(InputError, match="capture"):
        report(model, other, tmp_path / "folder")
    assert not (tmp_path / "folder").exists()


def test_names_cannot_break_the_page(model: RelightModel, capture: Capture, tmp_path: Path):
    names = ("</script><script>alert(1)</script>", *model.surfaces.names[1:])
    renamed = replace(model, surfaces=replace(model.surfaces, names=names))
    text = report(renamed, capture, tmp_path).read_text("utf-8")
    assert text.count("<script>") == 1 and Page(text)


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium here")
def test_its_sliders_move_in_a_browser_and_nothing_is_broken(path: Path, tmp_path: Path, capture: Capture):
    probed = tmp_path / "probed.html"
    probed.write_text(path.read_text("utf-8").replace("</body>", PROBE + "</body>"), "utf-8")
    command = [CHROMIUM, *FLAGS, f"--user-data-dir={tmp_path / 'profile'}", "--dump-dom", probed.as_uri()]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert "CONSOLE" not in done.stderr
    found = re.search(r'<pre id="seen">(.*?)</pre>', done.stdout)
    assert found is not None, done.stderr[-2000:]
    seen = json.loads(found.group(1))
    assert len(seen["sliders"]) == 1 + len(capture.split("test"))  # the large one on top, too
    for (clip, bar), (moved_clip, moved_bar) in seen["sliders"]:
        assert clip != moved_clip and moved_bar > bar + 50
    assert seen["broken"] == []
    assert seen["wide"] <= 390  # nothing hangs over the side of a phone
