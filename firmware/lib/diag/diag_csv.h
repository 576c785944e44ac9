/* SPDX-License-Identifier: Apache-2.0 */
/**
 * @file
 * The human-readable part of the diagnostic stream: CSV lines between the frames.
 *
 * Lines that begin with # name the columns and come with each HELLO. The first column of the
 * others says which kind of line it is. Times are microseconds of the node's own sync clock.
 *
 *   IMU,node,t_us,gyro_x_mdps,gyro_y_mdps,gyro_z_mdps,accel_x_mg,accel_y_mg,accel_z_mg
 *   shadow,...: see shadow_log.h; CONFIG_BV_SHADOW_LOG
 *   SYNC,node,t_us,state,offset_ns,skew_ppb,residual_rms_ns,offset_sigma_ns,pairs_used,pairs_dropped
 */
#ifndef BV_DIAG_CSV_H_
#define BV_DIAG_CSV_H_

#include "wire.h"

#ifdef __cplusplus
extern "C" {
#endif

/** Lines that name the columns. */
void diag_csv_header(void);

/** At most ten lines a second: the first sample of @p batch, in physical units. */
void diag_csv_imu(const struct wire_imu_batch *batch);

/** The clock model in force. */
void diag_csv_sync(const struct wire_sync_state *state);

#ifdef __cplusplus
}
#endif

#endif /* BV_DIAG_CSV_H_ */
