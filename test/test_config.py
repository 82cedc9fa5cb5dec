# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The files for other tools name what the node really has."""

from __future__ import annotations

import json
from pathlib import Path
import re
import xml.etree.ElementTree as ElementTree

import pytest
import yaml

CONFIG = Path(__file__).parents[1] / 'config'
NODE_PAGE = (CONFIG.parent / 'docs' / 'node.md').read_text()


def named_topics(direction):
    """Names that the page's table of topics and services gives for a direction."""
    rows = [line for line in NODE_PAGE.splitlines() if line.startswith(f'| {direction} |')]
    return {name for row in rows for name in re.findall(r'`([^`]+)`', row.split('|')[2])}


def absolute(name):
    return '/' + name.replace('~/', 'localizer/').lstrip('/')


def strings(tree):
    if isinstance(tree, dict):
        for key, value in tree.items():
            yield str(key)
            yield from strings(value)
    elif isinstance(tree, list):
        for value in tree:
            yield from strings(value)
    elif isinstance(tree, str):
        yield tree


def test_the_policy_allows_what_the_page_of_the_node_lists():
    profile = ElementTree.parse(CONFIG / 'sros2_policy.xml').getroot().find('.//profile')
    allowed = {
        (kind.tag, *kind.attrib): {absolute(item.text) for item in kind}
        for kind in profile
    }
    subscribed = {absolute(name) for name in named_topics('in')}
    published = {absolute(name) for name in named_topics('out')}
    assert allowed['topics', 'subscribe'] == subscribed | {
        '/tf', '/tf_static', '/clock', '/bond',
    }
    assert allowed['topics', 'publish'] == published | {
        '/tf', '/bond', '/rosout', '/parameter_events', '/localizer/transition_event',
    }
    served = {absolute(name) for name in named_topics('service')}
    assert served <= allowed['services', 'reply']


@pytest.mark.parametrize('name', ['localizer.rviz', 'foxglove.json'])
def test_layouts_show_topics_of_the_node(name):
    text = (CONFIG / name).read_text()
    tree = json.loads(text) if name.endswith('.json') else yaml.safe_load(text)
    known = {absolute(topic) for way in ('in', 'out') for topic in named_topics(way)}
    named = {word.split('.')[0] for word in strings(tree) if word.startswith('/')}
    assert named - {'/map_updates'} <= known
    assert {'/map', '/pose_with_covariance', '/initialpose', '/localizer/overlay'} <= named
