"""Singular values of numbers of any size: NumPy's, where it knows an end."""

import numpy as np
import pytest

from nhpocp.singular_values import svd


@pytest.mark.parametrize("power", [-1000, -700, 0, 500, 1000])
@pytest.mark.parametrize("shape", [(3, 5), (4, 3, 7)])
def test_they_scale_with_the_matrix(power, shape):
    matrix = np.random.default_rng(0).normal(size=shape)
    left, values, right = svd(np.ldexp(matrix, power), full_matrices=False)
    np.testing.assert_allclose(values, np.ldexp(svd(matrix, compute_uv=False), power), rtol=1e-12)
    again = (left * np.ldexp(values, -power)[..., None, :]) @ right
    np.testing.assert_allclose(again, matrix, atol=1e-13)


def test_what_is_not_finite_has_none():
    for entry in (np.nan, np.inf):
        with pytest.raises(np.linalg.LinAlgError):
            svd(np.array([[1.0, entry], [0.0, 1.0]]))
    assert not svd(np.zeros((2, 3)), compute_uv=False).any()
