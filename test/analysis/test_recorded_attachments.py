"""What attachments may name."""

import pytest

from ballbot_ros.analysis.recorded_scenario import read_attachments
from ballbot_ros.recording.reader import AttachedFile
from ballbot_ros.robot.world.floor_map import read_map_file

HEAD = 'purpose: a test\nduration: 2\n'
OWN_MAP = {
    'relative': f'{HEAD}map: ../house.png\n',
    'absolute': f'{HEAD}map: /nowhere/house.png\n',
    'parameter': f'{HEAD}parameters: {{plant_sim: {{map: /nowhere/house.png}}}}\n',
}


@pytest.mark.parametrize('text', OWN_MAP.values(), ids=OWN_MAP)
def test_a_scenario_has_the_attached_map_and_reads_no_other_file(text):
    def read(**files):
        attached = {name: AttachedFile('', data) for name, data in files.items()}
        return read_attachments(attached)

    scenario = {'scenario.yaml': text.encode()}
    assert read(**scenario, **{'map.png': read_map_file('track')}).scenario is not None
    without = read(**scenario)
    assert without.scenario is None
    assert 'map.png: No such file or directory; no expectation is judged.' in without.notices[0]
