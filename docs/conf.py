"""Configuration of the documentation site; `scripts/docs` builds it."""

import inspect
import re
import sys
from pathlib import Path
from textwrap import dedent

from docutils import nodes
from sphinx import addnodes
from sphinx.application import Sphinx

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / 'scripts/programs')]

from ballbot_ros import __version__  # noqa: E402
from benchmark.reference_pages import command_help, parameter_tables  # noqa: E402

project = 'ballbot_ros'
author = project_copyright = 'ballbot_ros developers'
version = release = __version__

extensions = [
    'myst_nb',
    'sphinx.ext.autodoc',
    'sphinx.ext.autosummary',
    'sphinx.ext.napoleon',
]
exclude_patterns = ['_build', 'examples']

# A link to a public name of the package must lead there; types of other packages have no page.
nitpicky = True
nitpick_ignore_regex = [('py:(class|exc|obj)', r'(?!ballbot_ros\.).*|.*\._\w+')]

# A public name is described in its package and in its module: links lead to the package.
suppress_warnings = ['ref.python']

# GitHub's anchors of headings: `architecture.md#where-is-`.
myst_heading_anchors = 4

# Notebooks are executed at each build; an exception in a cell is a warning, which fails the build.
# They run in their own folder, so that they can import lessons.py, and write no files.
nb_execution_mode = 'force'
nb_execution_in_temp = False
nb_execution_show_tb = True
nb_execution_timeout = 300

autodoc_default_options = {'members': True, 'show-inheritance': True}
autodoc_member_order = 'bysource'
autodoc_typehints_format = 'short'

# Types in docstrings are words, such as `tuple of int`: show them without links.
napoleon_google_docstring = False
napoleon_use_param = False
napoleon_use_rtype = False
napoleon_custom_sections = [('Attributes', 'params_style')]

templates_path = ['_templates']
html_theme = 'furo'
html_title = f'{project} {release}'
html_static_path = ['_static']
html_css_files = ['site.css']
html_copy_source = False
html_show_sphinx = False

# The pages that include a file from outside this folder.
INCLUDED_IN = {
    str(ROOT / 'README'): 'index',
    str(ROOT / 'CONTRIBUTING'): 'contributing',
    str(ROOT / 'CHANGELOG'): 'changelog',
}


def setup(app: Sphinx) -> None:
    """Adapt the pages, which are written for GitHub, to the site."""
    app.connect('config-inited', write_references)
    app.connect('include-read', adapt_included_links)
    app.connect('doctree-read', adapt_links)
    app.connect('doctree-read', adapt_diagrams)
    app.connect('autodoc-process-docstring', protect_first_colon, priority=400)
    app.connect('autodoc-skip-member', skip_tuple_fields)


def write_references(app: Sphinx, config: object) -> None:
    """Write what pages include of the code: the parameters, and the help of the commands."""
    folder = ROOT / 'docs/api/packages'
    folder.mkdir(exist_ok=True)
    (folder / 'parameters.txt').write_text(parameter_tables(), encoding='utf-8')
    (folder / 'commands.txt').write_text(command_help(), encoding='utf-8')


def adapt_included_links(app: Sphinx, file: Path, parent: str, content: list[str]) -> None:
    """Make the links of a file in the root of the repository relative to this folder."""
    content[0] = re.sub(
        r'(?<=\]\()(?!https?:|#)(docs/)?',
        lambda match: '' if match[1] else '../',
        content[0],
    )


def adapt_links(app: Sphinx, doctree: nodes.document) -> None:
    """Let links to an included file lead to its page, and unlink folders, which have no page."""
    folder = Path(app.env.doc2path(app.env.docname)).parent
    for link in list(doctree.findall(addnodes.pending_xref)):
        target = link['reftarget']
        if link['reftype'] != 'myst':
            continue
        if link['refdomain'] == 'doc':
            link['reftarget'] = INCLUDED_IN.get(target, target)
        elif not link['refdomain'] and (folder / target).is_dir():
            link.replace_self(link.children)


def adapt_diagrams(app: Sphinx, doctree: nodes.document) -> None:
    """Show a flowchart of Mermaid as text, which needs no JavaScript from elsewhere."""
    for block in doctree.findall(nodes.literal_block):
        if block.get('language') == 'mermaid':
            _, edges = block.astext().split('\n', 1)
            text = re.sub('-- "(.+?)" -->', r'── \1 ─▶', dedent(edges))
            block['language'] = 'text'
            block.children = [nodes.Text(text)]
            block.rawsource = text


def protect_first_colon(
    app: Sphinx, what: str, name: str, member: object, options: object, lines: list[str]
) -> None:
    """Keep napoleon from reading the start of `Period [s]: ...` as a type.

    It looks for a type in the first line only, which is an empty comment after this.
    """
    if what in ('attribute', 'data', 'property'):
        lines[:0] = ['..', '']


def skip_tuple_fields(
    app: Sphinx, what: str, name: str, member: object, skip: bool, options: object
) -> bool | None:
    """Leave out "Alias for field number 0"; the class describes its fields."""
    return True if (inspect.getdoc(member) or '').startswith('Alias for field number') else None
