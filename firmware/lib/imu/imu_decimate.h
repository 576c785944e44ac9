/* SPDX-License-Identifier: Apache-2.0 */
/**
 * @file
 * IMU batches at a lower rate, band-limited and with exact times. Pure C11.
 *
 * A cascade of half-band filters, each of which halves the rate. All are symmetric, so a sample
 * that comes out belongs to the instant of one that went in: sample J of the output is at the
 * instant of sample J * factor of the input, and its index is J. A hole in the input restarts the
 * filters and leaves a hole in the output.
 *
 * Each filter has equal ripple in its stop band; as pass and stop band of a half-band filter mirror
 * each other, the ripple of the pass band is the same. The last stage has 23 taps and stops from
 * 0.32 of its input rate on, by 58 dB. The stages before it only have to keep the band of the last
 * one clean: 11 taps from 0.41 on, 7 taps from 0.455 on, both better than 70 dB. So the output is
 * flat within 0.2 % up to 0.36 of its rate, and the delay is 8.6 ms from 6667 to 833 Hz.
 */
#ifndef BV_IMU_DECIMATE_H_
#define BV_IMU_DECIMATE_H_

#include <stdbool.h>
#include <stdint.h>

#include "wire.h"

#ifdef __cplusplus
extern "C" {
#endif

#define IMU_DECIMATE_STAGES_MAX 4U
#define IMU_DECIMATE_TAPS_MAX   23U
#define IMU_DECIMATE_AXES       6U

struct imu_decimate_stage {
	/** The last samples, counts * 256, the newest at @ref at. */
	int32_t line[IMU_DECIMATE_TAPS_MAX][IMU_DECIMATE_AXES];
	uint32_t at;
	/** How many of them are of the present run. */
	uint32_t filled;
	/** Index of the next input sample. */
	uint32_t next_index;
};

/** Takes one batch of the output; valid during the call. */
typedef void (*imu_decimate_out)(void *context, const struct wire_imu_batch *batch);

/** State; the members are public so that a test can set and read them. */
struct imu_decimate {
	struct imu_decimate_stage stage[IMU_DECIMATE_STAGES_MAX];
	uint32_t stages;
	uint8_t batch_samples;
	/** Output that waits to become a whole batch. */
	struct wire_imu_batch pending;
	/** Index expected next at the input; whether one is. */
	uint32_t next_index;
	bool running;
	/** Flags of the input to be passed on. */
	uint8_t sticky_flags;
};

/**
 * @param factor 1, 2, 4, 8 or 16; of others the next lower one is taken. 1 passes batches through.
 * @param batch_samples samples in a batch of the output, 1 .. WIRE_IMU_BATCH_MAX_COUNT.
 */
void imu_decimate_init(struct imu_decimate *decimate, uint32_t factor, uint8_t batch_samples);

/** Take one batch of the input; deliver what comes of it. */
void imu_decimate_push(struct imu_decimate *decimate, const struct wire_imu_batch *batch,
		       imu_decimate_out out, void *context);

#ifdef __cplusplus
}
#endif

#endif /* BV_IMU_DECIMATE_H_ */
