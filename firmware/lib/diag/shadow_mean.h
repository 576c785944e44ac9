/* SPDX-License-Identifier: Apache-2.0 */
/**
 * @file
 * Means of a node's samples over each 10 ms of its clock. Pure C11, whole numbers throughout, so
 * that a host comes to the same ones.
 */
#ifndef BV_SHADOW_MEAN_H_
#define BV_SHADOW_MEAN_H_

#include <stdbool.h>
#include <stdint.h>

#include "shadow_row.h"
#include "wire.h"

#ifdef __cplusplus
extern "C" {
#endif

/** State; all zero at the start. */
struct shadow_mean {
	/** Number of the cell that is being summed up, and its samples so far. */
	uint64_t cell;
	uint32_t count;
	int32_t accel_lsb[3];
	int32_t gyro_lsb[3];
	uint64_t t_first_ticks;
	uint64_t t_last_ticks;
	uint8_t accel_fs_g;
	uint16_t gyro_fs_dps;
	uint16_t flags;
	/** Index of the next sample if none is lost. */
	uint32_t next_index;
	bool running;
};

/** Takes one row; valid during the call. */
typedef void (*shadow_mean_out)(const struct shadow_row *row);

/** Take one batch; deliver the cells that ended before its last sample. */
void shadow_mean_push(struct shadow_mean *mean, const struct wire_imu_batch *batch,
		      shadow_mean_out out);

#ifdef __cplusplus
}
#endif

#endif /* BV_SHADOW_MEAN_H_ */
