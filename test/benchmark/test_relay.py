"""The arrangements that the benchmark compares with the graph."""

from benchmark.runs import measured, run_encoded_loop, run_relay


def test_the_relay_and_the_loop_run_to_their_ends():
    for run in (run_relay, run_encoded_loop):
        result = measured(run, 0.1)
        assert result.real_time_factor > 0.0
        assert result.start_s > 0.0
        assert result.duty_sha256 is None
