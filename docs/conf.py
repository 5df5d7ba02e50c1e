"""Settings of the documentation site: `make docs` builds it into out/docs, offline and with warnings as errors."""

import re
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent), str(HERE)]

from site_pages import mathml, reference, reports  # noqa: E402

from modelling.errors import VERSION  # noqa: E402

project, author, release = "rigmatch", "The rigmatch authors", VERSION
root_doc = "index"
extensions = ["myst_parser", "sphinx.ext.autodoc", "numpydoc", "sphinx_copybutton", "sphinx_design"]
source_suffix = {".md": "markdown", ".rst": "restructuredtext"}
exclude_patterns = ["README.md", "site_pages"]
myst_enable_extensions = ["dollarmath", "deflist", "colon_fence"]
myst_heading_anchors = 3
numpydoc_show_class_members = False
numpydoc_xref_param_type = False
autodoc_typehints = "none"
html_theme = "furo"
html_static_path = ["_static"]
html_extra_path = [str(reports.unpack().relative_to(HERE))]
html_css_files = ["equations.css"]
html_title = f"rigmatch {VERSION}"
html_theme_options = {"source_repository": "", "top_of_page_buttons": []}
html_show_copyright = html_show_sphinx = False
html_copy_source = html_show_sourcelink = False
html_math_renderer = "mathml"
highlight_language = "text"

UPWARD = re.compile(r"(?<!!)\[([^\]]*)\]\((\.\./[^)#]*)(?:#[^)]*)?\)")  # a link that may leave docs/


def name_outside(_app, page: str, source: list[str]) -> None:
    """Links to files that are not pages of the site become their names in the source tree; they have to exist."""

    def named(link: re.Match[str]) -> str:
        text, target = link[1], ((HERE / page).parent / link[2]).resolve()
        if target.is_relative_to(HERE):
            return link[0]
        if not target.exists():
            raise FileNotFoundError(f"{page}: {link[2]}")
        name = target.relative_to(HERE.parent).as_posix()
        return f"`{name}`" if text.strip("`") == name else f"{text} (`{name}`)"

    source[0] = UPWARD.sub(named, source[0])


def with_levels(_app, _page: str, _template: str, context: dict, _tree) -> None:
    """Captions of the navigation are headings: a screen reader has to know of which level."""
    for name, part in context.items():
        if isinstance(part, str) and 'role="heading"' in part:
            context[name] = part.replace('role="heading"', 'role="heading" aria-level="2"')


def setup(app) -> None:
    """Generated pages, and equations as MathML, which browsers show without a script."""
    app.connect("builder-inited", lambda app: reference.write(Path(app.srcdir) / "reference"))
    app.connect("source-read", name_outside)
    app.connect("html-page-context", with_levels, priority=900)  # behind the theme, which makes the navigation
    mathml.register(app)
