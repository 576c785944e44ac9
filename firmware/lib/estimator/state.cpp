// SPDX-License-Identifier: Apache-2.0
#include "state.hpp"

namespace bv
{
namespace
{

template <class Scalar> Matrix3<Scalar> block(const Covariance<Scalar> &P, int i, int j)
{
	return P.template block<3, 3>(i, j);
}

/// A block on the diagonal, its lower triangle filled in.
template <class Scalar> Matrix3<Scalar> diagonal_block(const Covariance<Scalar> &P, int i)
{
	Matrix3<Scalar> m;

	m << P(i, i), P(i, i + 1), P(i, i + 2), P(i, i + 1), P(i + 1, i + 1), P(i + 1, i + 2),
		P(i, i + 2), P(i + 1, i + 2), P(i + 2, i + 2);
	return m;
}

/// P <- F P F^T with F = I but for F_pv = dt I, F_vt = A, F_va = F_tg = B: (5).
template <class Scalar>
void propagate(Covariance<Scalar> &P, Scalar dt, const Matrix3<Scalar> &A, const Matrix3<Scalar> &B)
{
	using Block = Matrix3<Scalar>;

	const Block pv = block(P, AT_P, AT_V), pt = block(P, AT_P, AT_T);
	const Block pa = block(P, AT_P, AT_A), pg = block(P, AT_P, AT_G);
	const Block vv = diagonal_block(P, AT_V), vt = block(P, AT_V, AT_T);
	const Block va = block(P, AT_V, AT_A), vg = block(P, AT_V, AT_G);
	const Block tt = diagonal_block(P, AT_T), ta = block(P, AT_T, AT_A);
	const Block tg = block(P, AT_T, AT_G);
	const Block aa = diagonal_block(P, AT_A), ag = block(P, AT_A, AT_G);
	const Block gg = diagonal_block(P, AT_G);
	const Block B_transposed = B.transpose();

	// Rows of M = F P, as far as they are needed.
	const Block m_pv = pv + dt * vv;
	const Block m_pt = pt + dt * vt;
	const Block m_pa = pa + dt * va;
	const Block m_pg = pg + dt * vg;
	const Block m_vv = vv + A * vt.transpose() + B * va.transpose();
	const Block m_vt = vt + A * tt + B * ta.transpose();
	const Block m_va = va + A * ta + B * aa;
	const Block m_vg = vg + A * tg + B * ag;
	const Block m_tt = tt + B * tg.transpose();
	const Block m_ta = ta + B * ag.transpose();
	const Block m_tg = tg + B * gg;

	// M F^T; A is skew, so A^T = -A.
	P.template block<3, 3>(AT_P, AT_P) += dt * (pv.transpose() + m_pv);
	P.template block<3, 3>(AT_P, AT_V) = m_pv - m_pt * A + m_pa * B_transposed;
	P.template block<3, 3>(AT_P, AT_T) = m_pt + m_pg * B_transposed;
	P.template block<3, 3>(AT_P, AT_A) = m_pa;
	P.template block<3, 3>(AT_P, AT_G) = m_pg;
	P.template block<3, 3>(AT_V, AT_V) = m_vv - m_vt * A + m_va * B_transposed;
	P.template block<3, 3>(AT_V, AT_T) = m_vt + m_vg * B_transposed;
	P.template block<3, 3>(AT_V, AT_A) = m_va;
	P.template block<3, 3>(AT_V, AT_G) = m_vg;
	P.template block<3, 3>(AT_T, AT_T) = m_tt + m_tg * B_transposed;
	P.template block<3, 3>(AT_T, AT_A) = m_ta;
	P.template block<3, 3>(AT_T, AT_G) = m_tg;
}

/// a = P h^T.
template <class Scalar>
ErrorState<Scalar> times(const Covariance<Scalar> &P, const Row<Scalar> &h)
{
	ErrorState<Scalar> a = ErrorState<Scalar>::Zero();

	for (int k = 0; k < h.count; k++) {
		const int at = h.index[k];
		const Scalar x = h.value[k];

		for (int i = 0; i < at; i++) {
			a[i] += x * P(i, at);
		}
		for (int i = at; i < ERROR_STATES; i++) {
			a[i] += x * P(at, i);
		}
	}
	return a;
}

template <class Scalar> Scalar dot(const Row<Scalar> &h, const ErrorState<Scalar> &x)
{
	Scalar sum = 0;

	for (int k = 0; k < h.count; k++) {
		sum += h.value[k] * x[h.index[k]];
	}
	return sum;
}

/// P <- P - sum K a^T on the upper triangle, in one pass over P.
template <class Scalar, int M>
void downdate(Covariance<Scalar> &P, const Correction<Scalar, M> &c)
{
	for (int i = 0; i < ERROR_STATES; i++) {
		Scalar gain[M];

		for (int k = 0; k < M; k++) {
			gain[k] = c.K[k][i];
		}
		for (int j = i; j < ERROR_STATES; j++) {
			Scalar x = P(i, j);

			// At -O2 GCC would leave a loop of three turns standing.
#pragma GCC unroll 3
			for (int k = 0; k < M; k++) {
				x -= gain[k] * c.a[k][j];
			}
			P(i, j) = x;
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

	propagate<Scalar>(nav.P, dt_s, skew(Vector3<Scalar>(-dt_s * f_world)), -dt_s * R);

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

template <class Scalar, int M>
Correction<Scalar, M> correction(const Nav<Scalar> &nav, const Measurement<Scalar, M> &m)
{
	Correction<Scalar, M> c;

	c.dx.setZero();
	c.nis = 0;
	for (int i = 0; i < M; i++) {
		// P H^T of a P that the components before have already brought down.
		c.a[i] = times(nav.P, m.row[i]);
		for (int k = 0; k < i; k++) {
			c.a[i] -= dot(m.row[i], c.a[k]) * c.K[k];
		}
		const Scalar s = dot(m.row[i], c.a[i]) + m.variance[i];
		const Scalar y = m.innovation[i] - dot(m.row[i], c.dx);
		const Scalar inverse = 1 / s;

		c.K[i] = c.a[i] * inverse;
		c.dx += y * c.K[i];
		c.nis += y * y * inverse;
	}
	return c;
}

template <class Scalar, int M> void apply(Nav<Scalar> &nav, const Correction<Scalar, M> &c)
{
	downdate(nav.P, c);
	nav.p += c.dx.template segment<3>(AT_P);
	nav.v += c.dx.template segment<3>(AT_V);
	nav.q = normalised(multiply(exp(Vector3<Scalar>(c.dx.template segment<3>(AT_T))), nav.q));
	nav.b_a += c.dx.template segment<3>(AT_A);
	nav.b_g += c.dx.template segment<3>(AT_G);
}

#define BV_INSTANTIATE_SIZE(Scalar, M)                                                             \
	template Correction<Scalar, M> correction(const Nav<Scalar> &,                             \
						  const Measurement<Scalar, M> &);                 \
	template void apply(Nav<Scalar> &, const Correction<Scalar, M> &)

#define BV_INSTANTIATE(Scalar)                                                                     \
	template Vector3<Scalar> predict(const Params<Scalar> &, Nav<Scalar> &,                    \
					 const Vector3<Scalar> &, const Vector3<Scalar> &,         \
					 const Vector3<Scalar> &, Scalar,                          \
					 const ExtraNoise<Scalar> &);                              \
	BV_INSTANTIATE_SIZE(Scalar, 1);                                                            \
	BV_INSTANTIATE_SIZE(Scalar, 2);                                                            \
	BV_INSTANTIATE_SIZE(Scalar, 3)

BV_INSTANTIATE(float);
BV_INSTANTIATE(double);
#undef BV_INSTANTIATE
#undef BV_INSTANTIATE_SIZE

} // namespace bv
