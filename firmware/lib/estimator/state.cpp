// SPDX-License-Identifier: Apache-2.0
#include "state.hpp"

// Loops of three or fifteen turns, whose indices choose between the triangles of P: at -O2 GCC
// would leave them standing, and the choice with them.
#define BV_UNROLL _Pragma("GCC unroll 15")

namespace bv
{
namespace
{

/// An entry of the symmetric matrix.
template <class Scalar>
EIGEN_STRONG_INLINE Scalar entry(const Covariance<Scalar> &P, int i, int j)
{
	return i <= j ? P(i, j) : P(j, i);
}

/// x + B y
template <class Scalar>
EIGEN_STRONG_INLINE Vector3<Scalar> plus_turned(const Vector3<Scalar> &x, const Matrix3<Scalar> &B,
			    const Vector3<Scalar> &y)
{
	return {x[0] + B(0, 0) * y[0] + B(0, 1) * y[1] + B(0, 2) * y[2],
		x[1] + B(1, 0) * y[0] + B(1, 1) * y[1] + B(1, 2) * y[2],
		x[2] + B(2, 0) * y[0] + B(2, 1) * y[1] + B(2, 2) * y[2]};
}

/// Row i of P's block that begins at `row`, `column`.
template <class Scalar>
EIGEN_STRONG_INLINE Vector3<Scalar> row_of(const Covariance<Scalar> &P, int row, int column, int i)
{
	return {entry(P, row + i, column), entry(P, row + i, column + 1),
		entry(P, row + i, column + 2)};
}

template <class Scalar>
EIGEN_STRONG_INLINE void put_row(Covariance<Scalar> &P, int row, int column, int i, const Vector3<Scalar> &x)
{
	for (int j = 0; j < 3; j++) {
		P(row + i, column + j) = x[j];
	}
}

/// Row i of [a]x X + B Y for the blocks X and Y of P that begin at (x, column), (y, column).
template <class Scalar>
EIGEN_STRONG_INLINE Vector3<Scalar> driven(const Covariance<Scalar> &P, const Vector3<Scalar> &a, int x,
		       const Matrix3<Scalar> &B, int y, int column, int i)
{
	const int next = (i + 1) % 3, last = (i + 2) % 3;

	return a[next] * row_of(P, x, column, last) - a[last] * row_of(P, x, column, next) +
	       B(i, 0) * row_of(P, y, column, 0) + B(i, 1) * row_of(P, y, column, 1) +
	       B(i, 2) * row_of(P, y, column, 2);
}

/// P <- F P F^T with F = I but for F_pv = dt I, F_vt = [a]x, F_va = F_tg = B: (5).
///
/// Row by row of M = F P and of M F^T. A row takes from those below it only, which are still
/// old, so P is its own scratch.
template <class Scalar>
void propagate(Covariance<Scalar> &P, Scalar dt, const Vector3<Scalar> &a, const Matrix3<Scalar> &B)
{
	using Vector = Vector3<Scalar>;

	BV_UNROLL
	for (int i = 0; i < 3; i++) {
		const Vector v = row_of(P, AT_P, AT_V, i) + dt * row_of(P, AT_V, AT_V, i);
		const Vector t = row_of(P, AT_P, AT_T, i) + dt * row_of(P, AT_V, AT_T, i);
		const Vector b_a = row_of(P, AT_P, AT_A, i) + dt * row_of(P, AT_V, AT_A, i);
		const Vector b_g = row_of(P, AT_P, AT_G, i) + dt * row_of(P, AT_V, AT_G, i);

		for (int j = i; j < 3; j++) {
			P(AT_P + i, AT_P + j) += dt * (P(AT_P + j, AT_V + i) + v[j]);
		}
		put_row<Scalar>(P, AT_P, AT_V, i, plus_turned<Scalar>(v + cross(a, t), B, b_a));
		put_row<Scalar>(P, AT_P, AT_T, i, plus_turned(t, B, b_g));
		put_row(P, AT_P, AT_A, i, b_a);
		put_row(P, AT_P, AT_G, i, b_g);
	}
	BV_UNROLL
	for (int i = 0; i < 3; i++) {
		const int next = (i + 1) % 3, last = (i + 2) % 3;
		const Vector t = row_of(P, AT_V, AT_T, i) + driven(P, a, AT_T, B, AT_A, AT_T, i);
		const Vector b_a = row_of(P, AT_V, AT_A, i) + driven(P, a, AT_T, B, AT_A, AT_A, i);
		const Vector b_g = row_of(P, AT_V, AT_G, i) + driven(P, a, AT_T, B, AT_A, AT_G, i);
		const Vector at = cross(a, t);

		for (int j = i; j < 3; j++) {
			P(AT_V + i, AT_V + j) +=
				a[next] * P(AT_V + j, AT_T + last) -
				a[last] * P(AT_V + j, AT_T + next) +
				B(i, 0) * P(AT_V + j, AT_A) + B(i, 1) * P(AT_V + j, AT_A + 1) +
				B(i, 2) * P(AT_V + j, AT_A + 2) + at[j] + B(j, 0) * b_a[0] +
				B(j, 1) * b_a[1] + B(j, 2) * b_a[2];
		}
		put_row(P, AT_V, AT_T, i, plus_turned(t, B, b_g));
		put_row(P, AT_V, AT_A, i, b_a);
		put_row(P, AT_V, AT_G, i, b_g);
	}
	BV_UNROLL
	for (int i = 0; i < 3; i++) {
		Vector b_a = row_of(P, AT_T, AT_A, i);
		Vector b_g = row_of(P, AT_T, AT_G, i);

		for (int k = 0; k < 3; k++) {
			b_a += B(i, k) * row_of(P, AT_G, AT_A, k);
			b_g += B(i, k) * row_of(P, AT_G, AT_G, k);
		}
		for (int j = i; j < 3; j++) {
			P(AT_T + i, AT_T + j) +=
				B(i, 0) * P(AT_T + j, AT_G) + B(i, 1) * P(AT_T + j, AT_G + 1) +
				B(i, 2) * P(AT_T + j, AT_G + 2) + B(j, 0) * b_g[0] +
				B(j, 1) * b_g[1] + B(j, 2) * b_g[2];
		}
		put_row(P, AT_T, AT_A, i, b_a);
		put_row(P, AT_T, AT_G, i, b_g);
	}
}

/// One 3 x 3 tile of the downdate; of a tile on the diagonal the upper triangle alone.
template <bool Diagonal, class Scalar, int M>
EIGEN_STRONG_INLINE void downdate_tile(Covariance<Scalar> &P, int i, int j,
				       const Scalar (&gain)[3][M], const Scalar (*a)[M])
{
	BV_UNROLL
	for (int n = 0; n < 3; n++) {
		Scalar column[M];

		BV_UNROLL
		for (int k = 0; k < M; k++) {
			column[k] = a[j + n][k];
		}
		BV_UNROLL
		for (int r = 0; r < (Diagonal ? n + 1 : 3); r++) {
			Scalar x = P(i + r, j + n);

			BV_UNROLL
			for (int k = 0; k < M; k++) {
				x -= gain[r][k] * column[k];
			}
			P(i + r, j + n) = x;
		}
	}
}

/// P <- P - A D^-1 A^T, the columns of `a` one after the other, in one pass over P.
template <class Scalar, int M>
void downdate(Covariance<Scalar> &P, const Correction<Scalar, M> &c)
{
	for (int i = 0; i < ERROR_STATES; i += 3) {
		Scalar gain[3][M];

		BV_UNROLL
		for (int r = 0; r < 3; r++) {
			BV_UNROLL
			for (int k = 0; k < M; k++) {
				gain[r][k] = c.a[i + r][k] * c.inverse[k];
			}
		}
		downdate_tile<true>(P, i, i, gain, c.a);
		for (int j = i + 3; j < ERROR_STATES; j += 3) {
			downdate_tile<false>(P, i, j, gain, c.a);
		}
	}
}

} // namespace

template <class Scalar>
Vector3<Scalar> predict(const Params<Scalar> &params, Nav<Scalar> &nav,
			const Vector3<Scalar> &a_before, const Vector3<Scalar> &force,
			const Vector3<Scalar> &rate, Scalar dt_s, const ExtraNoise<Scalar> &extra)
{
	nav.q = normalised(multiply(nav.q, exp(Vector3<Scalar>((rate - nav.b_g) * dt_s))));
	const Matrix3<Scalar> R = matrix(nav.q);
	const Vector3<Scalar> f_world = R * (force - nav.b_a);
	const Vector3<Scalar> a = f_world - Vector3<Scalar>(0, 0, params.gravity_mps2);
	const Vector3<Scalar> v_before = nav.v;

	nav.v += Scalar(0.5) * dt_s * (a_before + a);
	nav.p += Scalar(0.5) * dt_s * (v_before + nav.v);

	propagate<Scalar>(nav.P, dt_s, -dt_s * f_world, -dt_s * R);

	const Scalar q_v = square(params.accel_noise_mps2_rthz) * dt_s + extra.v;
	const Scalar q_t = square(params.gyro_noise_radps_rthz) * dt_s + extra.theta;
	const Scalar q_a = square(params.accel_walk_mps2_rts) * dt_s + extra.a;
	const Scalar q_g = square(params.gyro_walk_radps_rts) * dt_s;

	nav.P(AT_PZ, AT_PZ) += square(params.height_walk_m_rts) * dt_s;
	for (int i = 0; i < 3; i++) {
		nav.P(AT_V + i, AT_V + i) += q_v;
		nav.P(AT_T + i, AT_T + i) += q_t;
		nav.P(AT_A + i, AT_A + i) += q_a;
		nav.P(AT_G + i, AT_G + i) += q_g;
	}
	return a;
}

template <class Scalar, int M, int At, int From, int Columns>
Correction<Scalar, M> correction(const Nav<Scalar> &nav,
				 const Measurement<Scalar, M, At, From, Columns> &m)
{
	const typename Measurement<Scalar, M, At, From, Columns>::Coupling h = m.coupling;
	Correction<Scalar, M> c;

	BV_UNROLL
	for (int j = 0; j < ERROR_STATES; j++) {
		BV_UNROLL
		for (int i = 0; i < M; i++) {
			Scalar x = 0;

			if (At >= 0) {
				x = entry(nav.P, j, At + i);
			}
			BV_UNROLL
			for (int k = 0; k < Columns; k++) {
				const Scalar share = h(i, k) * entry(nav.P, j, From + k);

				x = At < 0 && k == 0 ? share : x + share;
			}
			c.a[j][i] = x;
		}
	}
	BV_UNROLL
	for (int i = 0; i < M; i++) {
		BV_UNROLL
		for (int j = i; j < M; j++) {
			Scalar x = At >= 0 ? c.a[At < 0 ? 0 : At + i][j] : Scalar(0);

			BV_UNROLL
			for (int k = 0; k < Columns; k++) {
				x += h(i, k) * c.a[From + k][j];
			}
			c.s[i][j] = x;
		}
	}
	c.weigh(m.innovation, m.variance);
	return c;
}

template <class Scalar, int M>
void Correction<Scalar, M>::weigh(const Eigen::Matrix<Scalar, M, 1> &innovation, Scalar variance)
{
	nis = 0;
	BV_UNROLL
	for (int i = 0; i < M; i++) {
		Scalar d = s[i][i] + variance;
		Scalar left[M];

		y[i] = innovation[i];
		BV_UNROLL
		for (int k = 0; k < i; k++) {
			// Covariance with component k, less what those before k explain.
			Scalar shared = s[k][i];

			BV_UNROLL
			for (int n = 0; n < k; n++) {
				shared -= l[k][n] * left[n];
			}
			left[k] = shared;
			l[i][k] = shared * inverse[k];
			d -= l[i][k] * shared;
			y[i] -= l[i][k] * y[k];
		}
		inverse[i] = 1 / d;
		nis += y[i] * y[i] * inverse[i];
	}
}

template <class Scalar, int M> void apply(Nav<Scalar> &nav, Correction<Scalar, M> &c)
{
	ErrorState<Scalar> dx;

	for (int j = 0; j < ERROR_STATES; j++) {
		dx[j] = 0;
		BV_UNROLL
		for (int i = 0; i < M; i++) {
			BV_UNROLL
			for (int k = 0; k < i; k++) {
				c.a[j][i] -= c.l[i][k] * c.a[j][k];
			}
			dx[j] += c.a[j][i] * (c.inverse[i] * c.y[i]);
		}
	}
	downdate(nav.P, c);
	nav.p += dx.template segment<3>(AT_P);
	nav.v += dx.template segment<3>(AT_V);
	nav.q = normalised(multiply(exp(Vector3<Scalar>(dx.template segment<3>(AT_T))), nav.q));
	nav.b_a += dx.template segment<3>(AT_A);
	nav.b_g += dx.template segment<3>(AT_G);
}

#define BV_INSTANTIATE_SIZE(Scalar, M)                                                             \
	template struct Correction<Scalar, M>;                                                     \
	template void apply(Nav<Scalar> &, Correction<Scalar, M> &)

#define BV_INSTANTIATE_KIND(Scalar, M, At, From, Columns)                                          \
	template Correction<Scalar, M> correction(                                                 \
		const Nav<Scalar> &, const Measurement<Scalar, M, At, From, Columns> &)

#define BV_INSTANTIATE(Scalar)                                                                     \
	template Vector3<Scalar> predict(const Params<Scalar> &, Nav<Scalar> &,                    \
					 const Vector3<Scalar> &, const Vector3<Scalar> &,         \
					 const Vector3<Scalar> &, Scalar,                          \
					 const ExtraNoise<Scalar> &);                              \
	BV_INSTANTIATE_SIZE(Scalar, 1);                                                            \
	BV_INSTANTIATE_SIZE(Scalar, 2);                                                            \
	BV_INSTANTIATE_SIZE(Scalar, 3);                                                            \
	BV_INSTANTIATE_KIND(Scalar, 3, AT_V, 0, 0);                                                \
	BV_INSTANTIATE_KIND(Scalar, 3, AT_G, 0, 0);                                                \
	BV_INSTANTIATE_KIND(Scalar, 3, AT_A, AT_G, 3);                                             \
	BV_INSTANTIATE_KIND(Scalar, 2, NOWHERE, AT_T, 6);                                          \
	BV_INSTANTIATE_KIND(Scalar, 2, AT_V, 0, 0);                                                \
	BV_INSTANTIATE_KIND(Scalar, 1, AT_VZ, 0, 0);                                               \
	BV_INSTANTIATE_KIND(Scalar, 1, AT_PZ, AT_VZ, 3)

BV_INSTANTIATE(float);
BV_INSTANTIATE(double);
#undef BV_INSTANTIATE
#undef BV_INSTANTIATE_KIND
#undef BV_INSTANTIATE_SIZE
#undef BV_UNROLL

} // namespace bv
