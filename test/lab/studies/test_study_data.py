"""Results of a study are read by rows, columns and parts; summaries are those of all rows."""

import math
import shutil
import sys

import numpy as np
import pytest
from laws import refusal
from study_folders import MEASURES, NOW, PartRows, record, rows_of, write_part, write_study

pytest.importorskip('pyarrow')

from ballbot_ros.errors import MissingExtraError, StudyError
from ballbot_ros.lab.studies.data_set import begin_or_resume
from ballbot_ros.lab.studies.runs import Results
from ballbot_ros.lab.studies.study_data import QUANTILES, RunResults, StudyData, wilson_interval


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp('studies') / 'study'
    write_study(folder)
    return folder


@pytest.fixture
def data(folder):
    return StudyData.open(folder)


@pytest.fixture(scope='module')
def written():
    return [rows_of(record(), part) for part in range(3)]


def joined(written, get):
    return np.concatenate([get(each) for each in written])


def measured(written, number):
    return joined(written, lambda rows: rows.results.measured[:, number])


def test_table_and_frame_have_all_rows_in_order(data, written):
    pytest.importorskip('pandas')
    table = data.table()
    assert table.num_rows == 25
    assert table.column('number').to_pylist() == list(range(25))
    frame = data.frame()
    assert list(frame.columns) == [each.name for each in data.study.columns]
    assert frame['duty_sha256'][24] == written[2].results.duty_sha256[4].tobytes().hex()
    assert list(frame['plant_sim.model']) == joined(written, lambda rows: rows.varied[2]).tolist()
    np.testing.assert_array_equal(frame['settling_time_s'], measured(written, 1))


def test_a_row_is_that_of_its_run(data, written):
    for number in range(25):
        rows, place = written[number // 10], number % 10
        row = data.row(number)
        results = rows.results
        assert row == RunResults(
            number,
            int(rows.seed[place]),
            {
                each.name: column[place]
                for each, column in zip(data.study.varied, rows.varied, strict=True)
            },
            row.measures,
            bool(rows.passed[place]),
            'failed' if results.failed[place] else 'completed',
            bool(results.fallen[place]),
            int(results.ticks[place]),
            results.duty_sha256[place].tobytes().hex(),
        )
        assert list(row.measures) == [each.name for each in MEASURES]
        np.testing.assert_array_equal(list(row.measures.values()), results.measured[place])
    for number in (-1, 25):
        assert 'the runs are 0 to 24' in refusal(StudyError, data.row, number)


def test_columns_and_selections(data, written):
    numbers = np.arange(25)
    failed = joined(written, lambda rows: rows.results.failed)
    passed = joined(written, lambda rows: rows.passed)
    assert list(data.failed()) == numbers[failed].tolist()
    assert list(data.not_passed()) == numbers[~passed].tolist()
    settling = measured(written, 1)
    np.testing.assert_array_equal(data.column('settling_time_s'), settling)
    assert data.column('passed').tolist() == passed.tolist()
    assert np.isnan(data.column('wall_clearance_m')).all()
    assert [len(part['seed']) for part in data.parts(['seed'])] == [10, 10, 5]
    model = np.concatenate([part['plant_sim.model'] for part in data.parts(['plant_sim.model'])])
    assert model.tolist() == joined(written, lambda rows: rows.varied[2]).tolist()


def test_the_worst_runs(data, written):
    peaks = measured(written, 0)
    order = np.argsort(-peaks)[:4]
    worst = data.worst('peak_pitch_deg', 4)
    assert worst == list(zip(order.tolist(), peaks[order].tolist(), strict=True))
    final = measured(written, 2)
    farthest = np.argmax(np.abs(final - 0.2))
    assert data.worst('final_position_x_m[0,7.5]', 1) == [(farthest, final[farthest])]
    settling = data.worst('settling_time_s', 100)
    assert len(settling) == np.isfinite(measured(written, 1)).sum()
    assert data.worst('wall_clearance_m') == []
    assert data.worst('peak_pitch_deg', 0) == []
    text = refusal(StudyError, data.worst, 'final_position_x_m')
    assert 'final_position_x_m[0,7.5]' in text


def test_of_equal_values_the_first_runs_are_the_worst(tmp_path):
    study = record(measures=MEASURES[:1], varied=())
    with begin_or_resume(tmp_path / 'study', study, NOW):
        for part in range(3):
            runs = len(study.numbers(part))
            no = np.zeros(runs, bool)
            values = np.ones((runs, 1))
            values[3] = 2.0
            results = Results(np.zeros((runs, 32), np.uint8), no.astype(int), no, no, values)
            write_part(tmp_path / 'study', study, part, PartRows(no.astype(int), [], results, no))
    data = StudyData.open(tmp_path / 'study')
    expected = [(3, 2.0), (13, 2.0), (23, 2.0), (0, 1.0), (1, 1.0)]
    assert data.worst('peak_pitch_deg', 5) == expected
    assert data.summary().measures[0].worst == expected[:3]


def test_the_summary_is_that_of_all_rows(data, written):
    summary = data.summary()
    totals = summary.totals
    assert totals == data.manifest.totals
    assert (totals.runs, totals.passed) == (25, joined(written, lambda rows: rows.passed).sum())
    assert summary.share_passed == totals.passed / 25
    assert summary.interval == wilson_interval(totals.passed, 25)
    for number, each in enumerate(summary.measures):
        values = measured(written, number)
        kept = values[~np.isnan(values)]
        assert (each.count, each.missing) == (len(kept), 25 - len(kept)), each.column.name
        if len(kept):
            np.testing.assert_array_equal(each.quantiles, np.quantile(kept, QUANTILES))
        else:
            assert np.isnan(each.quantiles).all()
        assert each.worst == data.worst(each.column.name, 3)


def test_an_interrupted_study_is_read_as_far_as_it_is(tmp_path, written):
    write_study(tmp_path / 'study', parts=[0, 2])
    data = StudyData.open(tmp_path / 'study')
    assert (data.present, data.missing) == ((0, 2), (1,))
    assert data.totals() == written[0].summary + written[2].summary
    assert data.column('number').tolist() == [*range(10), *range(20, 25)]
    assert data.summary().measures[0].count == 15
    assert {each.number for each in data.worst('peak_pitch_deg', 20)} == {
        *range(10), *range(20, 25),
    }  # fmt: skip
    assert data.row(24).number == 24
    assert 'has not been done yet' in refusal(StudyError, data.row, 13)


def test_a_study_without_results_has_a_summary(tmp_path):
    write_study(tmp_path / 'study', parts=[])
    data = StudyData.open(tmp_path / 'study')
    summary = data.summary()
    assert math.isnan(summary.share_passed)
    assert summary.interval == (0, 1)
    assert [each.count for each in summary.measures] == [0] * len(MEASURES)
    assert data.worst('peak_pitch_deg') == []
    assert 'no results yet' in refusal(StudyError, data.table)


def test_missing_and_damaged_parts_are_named(tmp_path, folder):
    target = shutil.copytree(folder, tmp_path / 'study')
    path = target / 'parts/part-000001.parquet'
    data = StudyData.open(target)
    damaged = path.read_bytes()[:-100]
    for damage in (lambda: path.write_bytes(damaged), path.unlink):
        damage()
        for read in (data.table, data.totals, data.summary, lambda: data.row(10)):
            text = refusal(StudyError, read)
            assert str(path) in text
            assert 'give the command of the study again' in text
        assert data.row(9).number == 9
    assert str(path) in refusal(StudyError, StudyData.open, target)
    shutil.rmtree(target / 'parts')
    assert 'parts' in refusal(StudyError, StudyData.open, target)
    for other in (tmp_path / 'nothing', tmp_path):
        assert 'not the folder of a study' in refusal(StudyError, StudyData.open, other)


def test_missing_packages_are_named(data, folder, monkeypatch):
    with monkeypatch.context() as patched:
        patched.setitem(sys.modules, 'pyarrow', None)
        text = refusal(MissingExtraError, StudyData.open, folder)
        assert 'ballbot_ros[study]' in text
    monkeypatch.setitem(sys.modules, 'pandas', None)
    assert 'ballbot_ros[pandas]' in refusal(MissingExtraError, data.frame)
