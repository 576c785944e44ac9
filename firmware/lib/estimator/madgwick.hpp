// SPDX-License-Identifier: Apache-2.0
/// Madgwick's gradient filter for an IMU: the baseline beside the EKF.
///
/// S. Madgwick, An efficient orientation filter for inertial and inertial/magnetic sensor
/// arrays, 2010, eq. 25, 26, 33 and 42-44, with the quaternion turned to body-to-world.
#ifndef BV_ESTIMATOR_MADGWICK_HPP_
#define BV_ESTIMATOR_MADGWICK_HPP_

#include "attitude.hpp"

namespace bv
{

/// One step: gyroscope integration and a step of gain_radps * dt_s down the gradient.
template <class Scalar>
Quaternion<Scalar> madgwick_step(const Quaternion<Scalar> &q, const Vector3<Scalar> &force,
				 const Vector3<Scalar> &rate, Scalar dt_s, Scalar gain_radps);

} // namespace bv

#endif // BV_ESTIMATOR_MADGWICK_HPP_
