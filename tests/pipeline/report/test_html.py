"""Pages stand alone, and what people write into names and texts stays text."""

from html.parser import HTMLParser

from pipeline.report.html import (
    TextTable,
    bullet_list,
    document,
    heading,
    paragraph,
    png,
    preformatted,
    svg_figure,
    table_html,
)

SVG = (
    '<?xml version="1.0"?>\n<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="x">'
    '<path id="a"/><use xlink:href="#a" clip-path="url(#b)"/></svg>'
)
VOID = {"meta", "link", "img", "br"}


class Outline(HTMLParser):
    """Sources that a page names, and whether its elements close."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.sources: list[str] = []
        self.open: list[str] = []
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.sources += [value or "" for name, value in attrs if name in ("src", "href")]
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def assert_stands_alone(page: str) -> None:
    """Nothing is fetched, and every element is closed where it should be."""
    outline = Outline(page)
    assert outline.open == []
    assert outline.sources
    assert all(source.startswith(("data:", "#")) for source in outline.sources)


def test_a_page_of_all_parts_stands_alone() -> None:
    table = TextTable("t", ("a", "b"), (("1", "2"),), words=(1,))
    parts = [
        heading("h", anchor="there"),
        paragraph("p", "quiet"),
        bullet_list(["one", "two"]),
        table_html(table, ["#there"]),
        preformatted("x = 1\ny = 2"),
        png(b"\x89PNG", "picture"),
        svg_figure(SVG, "drawing", caption="c", name="first"),
    ]
    assert_stands_alone(document("title", "".join(parts)))


def test_what_people_write_stays_text() -> None:
    written = "<script>alert('k22 & k12')</script>"
    table = TextTable(written, (written,), ((written,),))
    page = document(
        written,
        heading(written) + paragraph(written) + bullet_list([written]) + table_html(table)
        + preformatted(written) + svg_figure(SVG, f'"{written}', caption=written, name="d"),
    )  # fmt: skip
    assert "<script" not in page
    assert page.count("k22 &amp; k12") >= 9


def test_two_drawings_on_one_page_keep_their_own_names() -> None:
    page = svg_figure(SVG, "one", name="one") + svg_figure(SVG, "two", name="two")
    assert 'id="one-a"' in page
    assert 'xlink:href="#two-a" clip-path="url(#two-b)"' in page
    assert "<?xml" not in page


def test_what_a_table_is_called_does_not_scroll_away_with_it() -> None:
    text = table_html(TextTable("springs", ("a",), (("1",),)))
    assert text.index("springs") < text.index('class="wide"')
    assert 'tabindex="0" aria-label="springs"' in text  # it scrolls by the keys, too


def test_an_empty_list_is_nothing() -> None:
    assert bullet_list([]) == ""


def test_the_first_cell_of_a_row_is_its_link() -> None:
    table = TextTable("turbines", ("name", "windows"), (("t<1>", "3"), ("t2", "4")))
    page = table_html(table, links=("#t1", "#t2"))
    assert '<td><a href="#t1">t&lt;1&gt;</a></td>' in page
    assert page.count("<a ") == 2
    assert page.index("#t2") < page.index(">4</td>")


def test_the_root_of_a_figure_alone_is_its_picture_and_its_ids_are_its_own() -> None:
    inner = '<svg id="a"><use href="#b" xlink:href="#c" fill="url(#d)"/></svg>'
    figure = svg_figure(f'<?xml version="1.0"?>\n<svg>{inner}</svg>\n', "a < b", name="n1")
    own = '<svg id="n1-a"><use href="#n1-b" xlink:href="#n1-c" fill="url(#n1-d)"/></svg>'
    assert figure == (f'<figure><svg role="img" aria-label="a &lt; b">{own}</svg></figure>\n')
    captioned = svg_figure("<svg></svg>", "", caption="5 > 4", name="n2")
    assert captioned.endswith("<figcaption>5 &gt; 4</figcaption></figure>\n")
