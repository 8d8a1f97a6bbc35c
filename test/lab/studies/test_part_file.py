"""A part is read as it was written, by all readers; any damage is found."""

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from laws import given, is_read_or_refused_in_one_line, refusal, settings
from study_folders import (
    MEASURES,
    NOW,
    VARIED,
    PartRows,
    encoded,
    record,
    rows_of,
    write_part,
    write_study,
)

pytest.importorskip('pyarrow')
import pyarrow.parquet

from ballbot_ros.errors import StudyError
from ballbot_ros.lab.studies.columns import DUTY_SHA256, ResultColumn
from ballbot_ros.lab.studies.data_set import begin_or_resume
from ballbot_ros.lab.studies.manifest import PartSummary
from ballbot_ros.lab.studies.part_file import DamagedPartError, check_part, read_columns, read_part
from ballbot_ros.lab.studies.runs import Results

REALS = st.floats(allow_nan=False)


def path_of(folder, study, part=0):
    return folder / 'parts' / study.part_name(part)


@pytest.fixture
def folder(tmp_path):
    with begin_or_resume(tmp_path / 'study', record(), NOW) as begun:
        yield begun.path


def columns_of(table):
    return {name: table.column(name).to_pylist() for name in table.column_names}


def assert_holds(table, study, part, rows):
    """Compare a table with the rows that were written."""
    found = columns_of(table)
    results = rows.results
    assert list(found) == [each.name for each in study.columns]
    assert found['number'] == list(study.numbers(part))
    assert found['seed'] == rows.seed.tolist()
    for column, values in zip(study.varied, rows.varied, strict=True):
        assert found[column.name] == values.tolist(), column
    for number, column in enumerate(study.measures):
        np.testing.assert_array_equal(
            np.array(found[column.name], float), results.measured[:, number]
        )
        assert (np.array(found[column.name]) == None).tolist() == np.isnan(  # noqa: E711
            results.measured[:, number]
        ).tolist()
    assert found['passed'] == rows.passed.tolist()
    assert found['outcome'] == np.where(results.failed, 'failed', 'completed').tolist()
    assert found['fallen'] == results.fallen.tolist()
    assert found['ticks'] == results.ticks.tolist()
    assert found[DUTY_SHA256.name] == [each.tobytes() for each in results.duty_sha256]


@st.composite
def parts(draw):
    """Return a study and a part of it with any values."""
    study = record(runs=draw(st.integers(1, 40)))
    part = draw(st.integers(0, study.parts - 1))
    runs = len(study.numbers(part))
    truths = arrays(bool, runs)
    integers = arrays(np.int64, runs, elements=st.integers(-(2**63), 2**63 - 1))
    texts = st.text(st.characters(exclude_categories=['Cs'], exclude_characters='\0'), max_size=8)
    varied = [
        draw(arrays(float, runs, elements=REALS)),
        draw(integers),
        draw(arrays('U8', runs, elements=texts)),
    ]
    results = Results(
        draw(arrays(np.uint8, (runs, 32))),
        draw(integers),
        draw(truths),
        draw(truths),
        draw(arrays(float, (runs, len(MEASURES)), elements=st.floats())),
    )
    return study, part, PartRows(draw(integers), varied, results, draw(truths))


@settings(max_examples=60)
@given(parts())
def test_a_part_is_read_as_it_was_written(tmp_path_factory, drawn):
    study, part, rows = drawn
    folder = tmp_path_factory.mktemp('study')
    (folder / 'parts').mkdir()
    summary = write_part(folder, study, part, rows)
    path = path_of(folder, study, part)
    assert_holds(read_part(path, study, part), study, part, rows)
    assert check_part(path, study, part) == summary
    results = rows.results
    counts = map(int, (rows.passed.sum(), results.failed.sum(), results.fallen.sum()))
    assert summary == PartSummary(len(rows.seed), *counts)
    names = ['plant_sim.body_mass', 'final_position_x_m[0,7.5]']
    few = read_columns(path, study, part, names)
    assert list(few) == names
    assert few[names[0]].tolist() == rows.varied[0].tolist()


def test_the_same_rows_are_the_same_bytes():
    study = record()
    first, again = (encoded(study, 1, rows_of(study, 1)).data for _ in range(2))
    assert first == again


def test_pandas_duckdb_and_polars_read_the_folder(tmp_path):
    pandas = pytest.importorskip('pandas')
    duckdb = pytest.importorskip('duckdb')
    polars = pytest.importorskip('polars')
    folder = tmp_path / 'study'
    study = write_study(folder)
    # What a dead writer leaves is in nobody's way.
    (folder / 'parts/.part-000001.parquet.0f.tmp').write_bytes(b'PAR1')
    written = [rows_of(study, part) for part in range(study.parts)]
    masses = np.concatenate([each.varied[0] for each in written]).tolist()
    models = np.concatenate([each.varied[2] for each in written]).tolist()
    peaks = np.concatenate([each.results.measured[:, 2] for each in written]).tolist()
    hashes = [bytes(row) for each in written for row in each.results.duty_sha256]
    missing = sum(np.isnan(each.results.measured[:, 1]).sum() for each in written)
    passed = np.concatenate([each.passed for each in written]).tolist()

    pattern = f'{folder}/parts/*.parquet'
    with duckdb.connect() as database:
        rows = database.sql(f"select * from '{pattern}'")
        assert rows.columns == [each.name for each in study.columns]
        query = (
            'select "plant_sim.body_mass", "plant_sim.model", "final_position_x_m[0,7.5]", passed, '
            f"duty_sha256 from '{pattern}' order by number"
        )
        found = zip(*database.sql(query).fetchall(), strict=True)
        assert list(map(list, found)) == [masses, models, peaks, passed, hashes]
        query = f"select count(*) - count(settling_time_s), avg(settling_time_s) from '{pattern}'"
        count, mean = database.sql(query).fetchall()[0]
        assert count == missing
        assert np.isfinite(mean)
        query = f"select count(*) from '{pattern}' where number >= 7 and outcome = 'completed'"
        assert 0 < database.sql(query).fetchall()[0][0] < 18
    for frame in (pandas.read_parquet(folder / 'parts'), polars.read_parquet(pattern)):
        assert list(frame.columns) == [each.name for each in study.columns]
        assert list(frame['number']) == list(range(25))
        assert list(frame['plant_sim.body_mass']) == masses
        assert list(frame['plant_sim.model']) == models
        assert list(frame['final_position_x_m[0,7.5]']) == peaks
        assert list(frame['passed']) == passed
        assert list(frame['duty_sha256']) == hashes


def test_the_file_explains_its_columns(folder):
    study = record()
    write_part(folder, study, 0, rows_of(study, 0))
    schema = pyarrow.parquet.read_schema(path_of(folder, study))
    mass = schema.field('plant_sim.body_mass')
    assert mass.metadata == {b'unit': b'kg', b'meaning': b'mass of the body'}
    assert schema.field('settling_time_s').metadata[b'unit'] == b's'
    assert schema.field('duty_sha256').type == pyarrow.binary(32)
    assert all(schema.field(each.name).metadata[b'meaning'] for each in MEASURES)
    assert json.loads(schema.metadata[b'ballbot_summary'])['runs'] == 10


def test_a_row_is_small_on_disk():
    """The goal is 40 B and 6 B a stored number, seeds among them, if seeds have 31 bits."""
    varied = tuple(ResultColumn(f'plant_sim.value_{number}') for number in range(6))
    study = record(varied=varied, measures=MEASURES[:2], runs=5000, runs_per_part=5000)
    random = np.random.default_rng(1)
    settling = np.round(random.gamma(2.0, 1.0, 5000) / 0.004) * 0.004
    measured = np.stack([random.lognormal(1.0, 0.5, 5000), settling], axis=1)
    failed = random.random(5000) < 0.05
    rows = PartRows(
        random.integers(0, 2**31, 5000),
        [random.uniform(0.8, 1.2, 5000) for _ in varied],
        Results(
            random.integers(0, 256, (5000, 32), np.uint8),
            np.where(failed, random.integers(100, 2500, 5000), 2500),
            failed,
            failed,
            measured,
        ),
        ~failed,
    )
    numbers = 1 + len(varied) + measured.shape[1]
    assert len(encoded(study, 0, rows).data) / 5000 <= 40 + 6.1 * numbers


def damages():
    """Yield names of kinds of damage, and what they make of a file's bytes."""
    random = np.random.default_rng(7)
    yield 'empty', lambda data: b''
    yield 'text', lambda data: b'not Parquet'
    yield 'zeros', lambda data: bytes(len(data))
    yield 'longer', lambda data: data + b'\0'
    for place in random.random(12):
        yield f'truncated at {place}', lambda data, place=place: data[: int(place * len(data))]
    for place in (0.0, 0.99999, *random.random(200)):

        def flip(data, place=place):
            at = int(place * len(data))
            return data[:at] + bytes([data[at] ^ (1 << at % 8)]) + data[at + 1 :]

        yield f'flipped at {place}', flip


def test_any_damage_is_found(folder):
    study = record()
    write_part(folder, study, 0, rows_of(study, 0))
    path = path_of(folder, study)
    good = path.read_bytes()
    for name, damage in damages():
        path.write_bytes(damage(good))
        for read in (check_part, read_part):
            assert str(path) in refusal(DamagedPartError, read, path, study, 0), name
    path.unlink()
    assert 'missing' in refusal(DamagedPartError, check_part, path, study, 0)
    path.mkdir()
    assert 'directory' in refusal(DamagedPartError, check_part, path, study, 0)


def test_reading_a_column_finds_damage_of_its_data(folder):
    study = record()
    write_part(folder, study, 0, rows_of(study, 0))
    path = path_of(folder, study)
    good = path.read_bytes()
    metadata = pyarrow.parquet.read_metadata(path).row_group(0)
    name = 'plant_sim.body_mass'
    column = next(
        metadata.column(number)
        for number in range(metadata.num_columns)
        if metadata.column(number).path_in_schema == name
    )
    last = column.data_page_offset + column.total_compressed_size - 1
    path.write_bytes(good[:last] + bytes([good[last] ^ 1]) + good[last + 1 :])
    assert str(path) in refusal(DamagedPartError, read_columns, path, study, 0, [name])
    read_columns(path, study, 0, ['number'])
    # Random damage, also of the metadata, gives an error of one line or the right names.
    for kind, damage in damages():
        path.write_bytes(damage(good))
        assert is_read_or_refused_in_one_line(read_columns, path, study, 0, [name]), kind


def test_parts_of_others_are_not_taken(folder):
    study = record()
    path = path_of(folder, study)
    for other, part, reason in (
        (record(seed=2), 0, 'not a part of this study'),
        (record(text='runs: 26\n'), 0, 'not a part of this study'),
        (study, 1, 'another part'),
    ):
        path.write_bytes(encoded(other, part, rows_of(other, part)).data)
        for read in (check_part, read_part):
            assert reason in refusal(DamagedPartError, read, path, study, 0), reason
        assert reason in refusal(DamagedPartError, read_columns, path, study, 0, ['number'])
    pyarrow.parquet.write_table(pyarrow.table({'number': list(range(10))}), path)
    assert 'not a part' in refusal(DamagedPartError, check_part, path, study, 0)
    assert 'not a part' in refusal(DamagedPartError, read_columns, path, study, 0, ['number'])


def test_rows_must_be_those_of_the_part():
    study = record()
    with pytest.raises(ValueError, match='part 2 has 5 runs, not 10'):
        encoded(study, 2, rows_of(study, 0))


def test_column_names_are_single():
    doubled = (*VARIED, ResultColumn('seed'))
    assert 'seed' in refusal(StudyError, lambda: record(varied=doubled))
    assert 'one run' in refusal(StudyError, lambda: replace(record(), runs=0))
