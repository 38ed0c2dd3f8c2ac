"""How Sphinx makes the site from build/site-source. Every file that a page asks for is its own."""

import re
import sys
from pathlib import Path

from sngr_utils import paths

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))  # for its own extension

project = "SNGR, reproduced"
author = "The SNGR reproduction project"
extensions = ["myst_nb", "sphinx-mathjax-offline", "glossary"]
exclude_patterns = ["downloads", "extra"]
html_extra_path = [str(paths.BUILD / "site-source" / "extra")]  # the films
default_role = "code"

nb_execution_mode = "off"
nb_merge_streams = True
myst_enable_extensions = ["dollarmath", "amsmath", "colon_fence", "deflist"]
myst_heading_anchors = 3
add_module_names = False  # the heading above has it
toc_object_entries = False
python_use_unqualified_type_names = True  # a signature links to World and shows no more than that

MACRO = re.compile(r"^\\newcommand\{\\(MAP|T)\}\{(.*)\}$", re.M)
macros = dict(MACRO.findall((paths.PAPER / "preamble.tex").read_text(encoding="utf-8")))
mathjax3_config = {"tex": {"macros": macros}}

html_theme = "sphinx_book_theme"
html_title = project
html_context = {"default_mode": "auto"}  # light or dark as the reader's system has it
html_theme_options = {
    "navbar_persistent": [],  # the side bar has the search
    "home_page_in_toc": True,
    "use_download_button": False,  # each chapter offers the notebook as it is in the repository
    "use_fullscreen_button": False,
    "pygments_light_style": "a11y-high-contrast-light",
    "pygments_dark_style": "a11y-high-contrast-dark",
}
html_static_path = [str(HERE / "static")]
html_css_files = ["site.css"]
html_js_files = ["sort.js"]
html_copy_source = False
html_use_index = html_domain_indices = False  # the search finds a name sooner
html_show_search_summary = False  # it is fetched, which a browser refuses in a folder
