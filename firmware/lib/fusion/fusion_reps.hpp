// SPDX-License-Identifier: Apache-2.0
/// Repetitions in the estimator's steps, as REP frames on the diagnostic stream. Private to
/// lib/fusion.
#ifndef BV_FUSION_REPS_HPP_
#define BV_FUSION_REPS_HPP_

#include "estimator.hpp"

/// Take one step. The thread of the estimator only.
void fusion_reps_take(const bv::Output<float> &output);

#endif // BV_FUSION_REPS_HPP_
