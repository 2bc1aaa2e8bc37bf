"""Small dense linear algebra in C: singular values by rotations, steps within a radius, determinants."""

from __future__ import annotations

ALGEBRA = r"""
static int all_finite(long long count, const double *numbers)
{
    for (long long i = 0; i < count; ++i)
        if (!isfinite(numbers[i]))
            return 0;
    return 1;
}

static double norm(int count, const double *vector)
{
    double sum = 0.0;
    for (int i = 0; i < count; ++i)
        sum += vector[i] * vector[i];
    return sqrt(sum);
}

/* Rotations from the left, together U transposed, that make the rows of a (rows x columns) orthogonal; e, if any, is
 * turned along. Then a = U diag(values) V transposed, and the rows left in a are the values times those of V
 * transposed. One-sided Jacobi method [Golub, Van Loan, Matrix Computations, 8.6]. */
static void decompose(int rows, int columns, double *a, double *e, double *values)
{
    int turned = 1;
    for (int sweep = 0; turned && sweep < SWEEPS; ++sweep) {
        turned = 0;
        for (int p = 0; p < rows; ++p) {
            for (int q = p + 1; q < rows; ++q) {
                double *x = a + p * columns, *y = a + q * columns;
                double xx = 0.0, xy = 0.0, yy = 0.0;
                for (int j = 0; j < columns; ++j) {
                    xx += x[j] * x[j];
                    xy += x[j] * y[j];
                    yy += y[j] * y[j];
                }
                if (!(fabs(xy) > ORTHOGONAL * sqrt(xx) * sqrt(yy)))
                    continue;
                const double zeta = (yy - xx) / (2.0 * xy);
                const double t = copysign(1.0, zeta) / (fabs(zeta) + sqrt(1.0 + zeta * zeta));
                const double c = 1.0 / sqrt(1.0 + t * t), s = c * t;
                turned = 1;
                for (int j = 0; j < columns; ++j) {
                    const double old = x[j];
                    x[j] = c * old - s * y[j];
                    y[j] = s * old + c * y[j];
                }
                if (e) {
                    const double old = e[p];
                    e[p] = c * old - s * e[q];
                    e[q] = s * old + c * e[q];
                }
            }
        }
    }
    for (int i = 0; i < rows; ++i)
        values[i] = norm(columns, a + i * columns);
}

static void extremes(int count, const double *values, double *least, double *largest)
{
    *least = *largest = values[0];
    for (int i = 1; i < count; ++i) {
        *least = fmin(*least, values[i]);
        *largest = fmax(*largest, values[i]);
    }
}
"""

# trust_region.within_radius and next_radius
STEPS_WITHIN = r"""
/* values e / (values^2 + mu) with the mu that makes its length the radius, or 0 if it is shorter: Newton's method on
 * 1/length [More, Sorensen 1983]. Nothing is done along values that are negligible. */
static void within_radius(const double *values, const double *e, double radius, double *inner)
{
    double squares[ROWS], products[ROWS], least, largest, damping = 0.0;
    extremes(ROWS, values, &least, &largest);
    for (int i = 0; i < ROWS; ++i) {
        const int negligible = values[i] <= NEGLIGIBLE * largest;
        squares[i] = negligible ? 1.0 : values[i] * values[i];
        products[i] = negligible ? 0.0 : values[i] * e[i];
        inner[i] = products[i] / squares[i];
    }
    for (int n = 0; n < DAMPINGS; ++n) {
        const double length = norm(ROWS, inner), excess = length / radius - 1.0;
        double slope = 0.0;
        if (!(excess > LONG))
            return;
        for (int i = 0; i < ROWS; ++i)
            slope += inner[i] * inner[i] / (squares[i] + damping);
        damping += excess * length * length / slope;
        for (int i = 0; i < ROWS; ++i)
            inner[i] = products[i] / (squares[i] + damping);
    }
}

/* The radius after a step of this size and gain ratio. */
static double next_radius(double radius, double size, double gain)
{
    if (gain < POOR)
        return (gain > 0.0 ? NARROWER : NARROWEST) * fmin(radius, size);
    return gain > GOOD ? fmax(radius, WIDER * size) : radius;
}
"""

DETERMINANT = r"""
/* By elimination with pivots. */
static double determinant(int size, const double *matrix)
{
    double a[LARGEST * LARGEST], product = 1.0;
    for (int i = 0; i < size * size; ++i)
        a[i] = matrix[i];
    for (int k = 0; k < size; ++k) {
        int pivot = k;
        for (int i = k + 1; i < size; ++i)
            if (fabs(a[i * size + k]) > fabs(a[pivot * size + k]))
                pivot = i;
        if (a[pivot * size + k] == 0.0)
            return 0.0;
        for (int j = 0; pivot != k && j < size; ++j) {
            const double old = a[k * size + j];
            a[k * size + j] = a[pivot * size + j];
            a[pivot * size + j] = old;
        }
        product *= pivot == k ? a[k * size + k] : -a[k * size + k];
        for (int i = k + 1; i < size; ++i) {
            const double factor = a[i * size + k] / a[k * size + k];
            for (int j = k + 1; j < size; ++j)
                a[i * size + j] -= factor * a[k * size + j];
        }
    }
    return product;
}
"""
