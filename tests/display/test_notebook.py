"""What a notebook shows of frames and models."""

from dataclasses import replace
from html.parser import HTMLParser

from relight3d.display.notebook import html_of_frame, html_of_model
from relight3d.records import RelightModel
from relight3d.relight.relighter import Relighter


class Tags(HTMLParser):
    """Collects what is opened and closed."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open, self.images = [], []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list) -> None:
        if tag == "img":
            self.images.append(dict(attrs)["src"])
        else:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def test_a_frame_shows_its_picture_and_cost(model: RelightModel):
    text = html_of_frame(Relighter(model).render(model.lights[0]))
    tags = Tags(text)
    assert tags.open == [] and len(tags.images) == 1 and tags.images[0].startswith("data:image/jpeg;base64,")
    assert "64 × 48 px" in text and "rays" in text


def test_a_model_shows_what_it_is_made_of(model: RelightModel):
    text = html_of_model(model)
    tags = Tags(text)
    assert tags.open == [] and len(tags.images) == 2
    for words in ("sphere (diffuse, glossy, 1 lobe)", "1,040 faces", "a warning"):
        assert words in text
    assert "none" in html_of_model(replace(model, indirect=None))


def test_names_cannot_break_the_page(model: RelightModel):
    names = ("<script>alert(1)</script>", *model.surfaces.names[1:])
    text = html_of_model(replace(model, surfaces=replace(model.surfaces, names=names)))
    assert "<script>" not in text and "&lt;script&gt;" in text
