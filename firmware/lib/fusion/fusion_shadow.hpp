// SPDX-License-Identifier: Apache-2.0
/// The estimator's filtered input in the shadow log. Private to lib/fusion.
#ifndef BV_FUSION_SHADOW_HPP_
#define BV_FUSION_SHADOW_HPP_

#include "estimator.hpp"

/// Take one step: what @p estimator was fed for @p output. The thread of the estimator only.
void fusion_shadow_take(const bv::Estimator<float> &estimator, const bv::Output<float> &output);

#endif // BV_FUSION_SHADOW_HPP_
