/* SPDX-License-Identifier: Apache-2.0 */
/**
 * @file
 * The shadow log: the node's filtered IMU at 100 Hz, as CSV lines between the frames.
 *
 *   #shadow,t_us_node,ax_mps2,ay_mps2,az_mps2,gx_radps,gy_radps,gz_radps,flags
 *   shadow,12345678,0.0123,-0.0045,9.8067,0.00012,-0.00340,0.00001,0
 *
 * The line that begins with # comes with each HELLO. Times are microseconds of the node's own 16 MHz
 * clock, 64 bit; they are those that the filtered values belong to.
 *
 * Leader: what its estimator is fed, behind its prefilter, in the bar frame. Of each 10 ms of the
 * node's clock the first sample; at rates below 100 Hz every sample.
 *
 * Follower: of each 10 ms of the node's clock the mean of the samples, at the middle of the first
 * and the last of them; sensor frame, corrected. A boxcar of 10 ms: -3.9 dB at 50 Hz, zeros at
 * multiples of 100 Hz, no delay.
 *
 * Nothing waits for the log: rows queue for a thread below all others, and what does not fit is
 * dropped and counted in SYSTEM's uart_dropped, as is what does not fit the line.
 */
#ifndef BV_SHADOW_LOG_H_
#define BV_SHADOW_LOG_H_

#include "shadow_row.h"
#include "wire.h"

#ifdef __cplusplus
extern "C" {
#endif

/** Log one row if it is the first of its 10 ms. Threads only; one of them; never waits. */
void shadow_log_sample(const struct shadow_row *row);

/** Log what the samples of @p batch, with times on this node's clock, make up. As above. */
void shadow_log_batch(const struct wire_imu_batch *batch);

#ifdef __cplusplus
}
#endif

#endif /* BV_SHADOW_LOG_H_ */
