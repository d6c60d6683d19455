# SPDX-License-Identifier: MIT
"""Contributions and inform of <meshkal/unscented.h>, against the information form of textbook.py (spec 4.1)."""
import numpy as np
import pytest

from nonlinear import covariance, linear, reading, sensors
from textbook import LONG, Textbook, Weights, distance
from unscented import EXTENDED, OK, UNSCENTED, Filter, status, transform


def test_information(code):
    """inform(contribution) is the update; the paper's form without the residual; scale; what is used up."""
    for seed in range(40):
        rng = np.random.default_rng([seed, 9])
        n = int(rng.integers(1, 8))
        models, x, P = sensors(rng, n), rng.normal(size=n) * 3, covariance(rng, n, 0.1, 2)
        truth = x + np.linalg.cholesky(P) @ rng.normal(size=n)
        z = {s: reading(rng, *models[s], truth) for s in range(len(models))}
        w, kind = dict(kappa=2) if seed % 2 else {}, EXTENDED if seed % 4 == 3 else UNSCENTED

        def fresh(put=True):
            f = Filter(code, n, np.eye(n), np.eye(n), models, x, P, kind=kind, transform=transform(n, **w))
            assert f.start() == OK
            for s in z if put else ():
                assert f.put(s, z[s]) == OK
            return f
        ukf, f, paper = fresh(), fresh(), fresh()
        assert ukf.update() == OK
        book = Textbook(n, np.eye(n), np.eye(n), models, x, P, Weights(n, **w), kind == EXTENDED)
        x_before, L_before = f.x.copy(), f.L.copy()
        for filter, without in ((f, 0), (paper, 1)):
            found, s, S = filter.contribution(without)
            assert found == OK
            s_book, S_book = book.information(z, bool(without))
            # In units of P: what no sensor sees has no scale of its own.
            unit = np.sqrt(np.diag(P))
            assert np.max(np.abs(S - S_book) * np.outer(unit, unit)) < 1e-11 * np.max(np.abs(S_book) * np.outer(unit, unit))
            assert np.max(np.abs(s - s_book) * unit) < 1e-11 * np.max(np.abs(s_book) * unit)
            assert (filter.x == x_before).all() and (filter.L == L_before).all()
            again = filter.contribution(without)
            assert again[0] == OK and not again[1].any() and not again[2].any(), "the readings are used up"
            for times in (1, 3):
                other = fresh(False)
                assert other.inform(times, s, S) == OK
                informed = Textbook(n, np.eye(n), np.eye(n), models, x, P)
                informed.inform(times, s_book, S_book)
                assert max(distance(other.x, other.P, informed)) < 1e-8
                if times == 1 and not without:
                    sigma = np.sqrt(np.diag(ukf.P))
                    # Through Y and back: rounding times the condition number.
                    limit = 1e-12 * max(1, np.linalg.cond(ukf.P) / 100)
                    assert np.max(np.abs(other.x - ukf.x) / sigma) < limit
                    assert np.max(np.abs(other.P - ukf.P) / np.outer(sigma, sigma)) < limit


@pytest.mark.parametrize("bits", (32, 64))
def test_indefinite_information(code, bits):
    """A sum of information that takes some away again, as consensus makes it."""
    taken = refused = 0
    for seed in range(200):
        rng = np.random.default_rng([seed, 10])
        n = int(rng.integers(1, 8))
        P, x, s = covariance(rng, n, 0.2, 2), rng.normal(size=n), rng.normal(size=n)
        values = rng.normal(size=n)
        vectors = np.linalg.qr(rng.normal(size=(n, n)))[0]
        S = (vectors * values) @ vectors.T
        f = Filter(code, n, np.eye(n), np.eye(n), [(linear(np.eye(n)), np.eye(n))], x, P, bits=bits)
        assert f.start() == OK
        before, whole = f.state(), np.linalg.eigvalsh(np.linalg.inv(P) + 0.7 * S)
        if abs(whole[0]) < 0.05:
            continue
        found = f.inform(0.7, s, S)
        if whole[0] > 0:
            taken += values.min() < 0
            book = Textbook(n, np.eye(n), np.eye(n), [], x, P)
            book.inform(LONG(0.7), s, S)
            assert found == OK and max(distance(f.x, f.P, book)) < (1e-10 if bits == 64 else 1e-3)
        else:
            refused += 1
            assert found == status("NOT_POSITIVE_DEFINITE") and f.state() == before
    assert taken > 20 and refused > 20, (taken, refused)
