"""What the page asks of a graph that is not all there yet."""

import contextlib

import pytest

pytest.importorskip('rclpy')

from rcl_interfaces.msg import ParameterType, ParameterValue
from rcl_interfaces.srv import GetParameters
from ros_client import Client

from ballbot_ros.nodes.base import offered_qos
from ballbot_ros.nodes.viewer_requests import ViewerRequests

pytestmark = pytest.mark.graph


def test_the_plant_is_asked_until_it_answers(domain):
    def answer(request, response):
        response.values = [
            ParameterValue(type=ParameterType.PARAMETER_STRING, string_value=f'the {name}')
            for name in request.names
        ]
        return response

    with contextlib.closing(Client(domain)) as client:
        client.node.advertise = lambda topic, depth: client.node.create_publisher(
            topic.message_class, topic.name, offered_qos(depth)
        )
        requests = ViewerRequests(client.node, print)
        answers = []
        requests.plant_parameters(['map'], answers.append)
        requests.make()
        # The plant's topics were found before its services.
        client.node.create_service(GetParameters, 'plant_sim/get_parameters', answer)

        def is_answered():
            requests.make()
            return answers

        client.spin_until(is_answered)
        assert answers == [{'map': 'the map'}]
