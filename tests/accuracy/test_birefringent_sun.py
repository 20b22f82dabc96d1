"""`relnav accuracy birefringent_sun`: the claims that hold and those that do not, as expected."""

import relnav


def test_every_row_is_as_expected():
    report = relnav.measure_accuracy("birefringent_sun", runs=200, seed=1)
    assert report.ok
    met = {(row.quantity, row.method): row.met for row in report.rows}
    assert met["axes from the sun alone", "two spots, 200 random crystals and directions"] is False
    assert met["gain over one spot", "over the ordinary, same noise in each spot"] is True
    assert met["gain over one spot", "over the extraordinary, same noise in each spot"] is False
    assert met["gain over one spot", "light shared by the spots"] is False
    assert met["gain over a conventional sun sensor", "hole on the same detector"] is False
    wide = {row.method: row for row in report.rows if row.quantity == "sigma of a wide field over that of a narrow one"}
    assert wide["same crystal"].met
    assert not wide["same detector"].met
    assert 1.5 < wide["same detector"].measured < 2.0  # tan 60 deg / tan 30 deg = 3 for a plain hole's depth
    assert {row.measured for row in report.rows if row.unit == "ratio" and row.statistic == "rank"} == {2.0}
    assert any("a polarised beacon on the target shows 3 axes" in note for note in report.notes)
