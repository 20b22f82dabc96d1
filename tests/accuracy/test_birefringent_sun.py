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
    assert {row.measured for row in report.rows if row.unit == "ratio" and row.statistic == "rank"} == {2.0}
    assert any("a polarised beacon on the target shows 3 axes" in note for note in report.notes)
