"""The folder of a topic: opened once, and after an error again."""

from browsing import receive
from graph import wait_for
from parts import DIMENSIONS

from ballbot_ros.errors import RecordingError
from ballbot_ros.viewer.page import Page
from ballbot_ros.viewer.plots import Plots, topic_kind
from ballbot_ros.viewer.recording_page import TopicChooser

TOPIC = '/mine/state'


class StubTopics:
    """A topic that can't be read at first."""

    def __init__(self):
        self.names = [TOPIC]
        self.reads = 0

    def read(self, topic, progress):
        progress(1, 2)
        self.reads += 1
        if self.reads == 1:
            raise RecordingError('run.mcap: gone')
        return {'error_m': topic_kind(topic, 'error_m')}, {'mode': 1.0}


def test_a_topic_is_read_once_and_after_an_error_again():
    page = Page(DIMENSIONS, 'test', '127.0.0.1', 0)
    gui, topics, notices = page.server.gui, StubTopics(), []
    TopicChooser(gui, Plots(gui, []), topics, notices.append)

    def inputs():
        known = list(gui._gui_input_handle_from_uuid.values())
        # While the topic is read, there is a progress bar, which has no label.
        return {each.label: each for each in known if hasattr(each, 'label')}

    button = inputs()[TOPIC]
    receive(page.server, (button, True))
    wait_for(lambda: notices and not button.disabled, what='the notice')
    assert notices == ['run.mcap: gone']
    assert inputs().keys() == {TOPIC}
    receive(page.server, (button, True), (button, True))
    wait_for(lambda: inputs().keys() == {'error_m'}, what='the folder')
    assert inputs()['error_m'].value is False
    assert topics.reads == 2
    page.stop()
