"""The files of the overlay, and viser's page with it."""

import gzip
import re
from pathlib import Path

import pytest

import ballbot_ros.viewer
from ballbot_ros.viewer.guarded_server import asset, index

FILES = sorted((Path(ballbot_ros.viewer.__file__).parent / 'assets').iterdir())


@pytest.mark.parametrize('file', FILES, ids=lambda file: file.name)
def test_each_file_is_served(file):
    content = asset(file.name)
    assert content.data == file.read_bytes()
    for name in re.findall(r"from '\./([^']+)'", content.data.decode()):
        assert asset(name)


@pytest.mark.parametrize('name', ['', '.', '..', '../page.py', 'none.js', '%2e%2e', '/etc/passwd'])
def test_nothing_else_is_served(name):
    assert asset(name) is None


def test_the_page_has_our_title_and_icon_and_starts_before_viser():
    page = gzip.decompress(index('<NXT> & "Ballbot"').data).decode()
    assert '<title>&lt;NXT&gt; &amp; &quot;Ballbot&quot;</title>' in page
    head = page[: page.index('<title>')]
    assert re.findall(r'rel="icon" href="([^"]+)"', head) == ['/assets/icon.svg']
    assert page.index('start.js') < page.index('data-p=')
