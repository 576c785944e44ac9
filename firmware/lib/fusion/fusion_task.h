/* SPDX-License-Identifier: Apache-2.0 */
/**
 * @file
 * The leader's fusion thread: IMU batches in, EKF and ATTITUDE frames out.
 */
#ifndef BV_FUSION_TASK_H_
#define BV_FUSION_TASK_H_

#include "wire.h"

#ifdef __cplusplus
extern "C" {
#endif

/**
 * Send one batch, of either IMU and with times on the leader's clock, on the diagnostic stream and
 * to the estimator. Threads only; never waits for the estimator.
 *
 * Uncorrected batches go to the stream only. Both get the others in the same order, so that whoever
 * reads the stream can repeat every step.
 */
void fusion_take(const struct wire_imu_batch *batch);

#ifdef __cplusplus
}
#endif

#endif /* BV_FUSION_TASK_H_ */
