/* SPDX-License-Identifier: Apache-2.0 */
/**
 * @file
 * The estimator's steps as frames on the diagnostic stream. Private to lib/fusion.
 */
#ifndef BV_FUSION_FRAMES_H_
#define BV_FUSION_FRAMES_H_

#include "wire.h"

#ifdef __cplusplus
extern "C" {
#endif

/** Take one batch and send what comes of it. One thread only. */
void fusion_frames_take(const struct wire_imu_batch *batch);

#ifdef __cplusplus
}
#endif

#endif /* BV_FUSION_FRAMES_H_ */
