/* SPDX-License-Identifier: Apache-2.0 */
/**
 * @file
 * The boot check: finds a second of stillness, measures the gyroscope's bias in it, and says
 * whether to believe it. Pure C11; time comes with the samples.
 *
 * The zero-rate level moves with temperature and from one power-up to the next, so a bias that was
 * stored weeks ago is the second best; but a bias measured on a bar that turns is worse than both.
 */
#ifndef BV_CALIB_BOOT_H_
#define BV_CALIB_BOOT_H_

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define CALIB_BOOT_TICKS_PER_S 16000000U

/** Length of a window: averages the noise to 4 mdps, and nobody waits long for it. */
#define CALIB_BOOT_WINDOW_TICKS CALIB_BOOT_TICKS_PER_S
/** Samples are missing after this long: what happened meanwhile is unknown. As in fusion. */
#define CALIB_BOOT_GAP_TICKS    (CALIB_BOOT_TICKS_PER_S / 4U)
/** A second at 12.5 Hz, less what the sensor's oscillator may be slow. */
#define CALIB_BOOT_SAMPLES_MIN  10U

/**
 * Standard deviation of each axis of the gyroscope. 3.8 mdps/rtHz (datasheet, table 2) in 833 Hz,
 * the widest band that reaches the check, is 0.11 dps.
 */
#define CALIB_BOOT_GYRO_STD_MAX_DPS 0.3f
/** Of each axis of the accelerometer: 110 ug/rtHz in 833 Hz is 3.2 mg. */
#define CALIB_BOOT_ACCEL_STD_MAX_MG 15.0f
/**
 * Distance of the mean forces in the first and the second half of a window: a steady turn is no
 * deviation from its own mean, but it tilts gravity. 4 mg within half a second is 0.46 dps about
 * any level axis; noise makes 0.2 mg of it. About the vertical nothing shows, and the limits of
 * the bias have to do.
 */
#define CALIB_BOOT_TILT_MAX_MG      4.0f

/** Change of the bias that needs no word: 30 degC make it, at 10 mdps/degC (datasheet, table 2). */
#define CALIB_BOOT_WARN_DPS   0.3f
/** Change beyond which something turned: twice the zero-rate tolerance of 1 dps (table 2). */
#define CALIB_BOOT_REFUSE_DPS 2.0f

enum calib_boot_event {
	/** The window goes on. */
	CALIB_BOOT_OPEN,
	/** It ended in motion; a new one has begun. */
	CALIB_BOOT_MOVED,
	/** It ended, and was still. */
	CALIB_BOOT_STILL,
};

/** State; the members are public so that a test can set and read them. */
struct calib_boot {
	/** Windows that ended, moving or still. */
	uint32_t attempts;
	/** Samples in the window; 0: it begins with the next one. */
	uint32_t count;
	/** Of those, in its first half. */
	uint32_t count_first;
	uint64_t t_begin_ticks;
	uint64_t t_last_ticks;
	/**
	 * The window's first sample: sums are of differences to it, so that they stay small. Were
	 * it an outlier, it would be in the variance itself, far above the rounding of the sums.
	 */
	float origin[6];
	float sum[6];
	float sum_squares[6];
	/** Of the accelerometer in the first half. */
	float sum_first[3];
	/** Mean rate of the last window that was still. */
	float gyro_bias_radps[3];
};

/** All zero but the attempts: also to drop the window when the samples start anew. */
void calib_boot_restart(struct calib_boot *boot);

/** Take one raw sample. After CALIB_BOOT_STILL the bias can be read, and a new window begins. */
enum calib_boot_event calib_boot_push(struct calib_boot *boot, uint64_t t_ticks,
				      const float gyro_radps[3], const float accel_mps2[3]);

/**
 * What to make of a measured bias.
 *
 * @param[out] delta_dps distance of the two biases.
 * @return WIRE_BOOT_CHECK_APPLIED, _WARNED or _REFUSED.
 */
uint8_t calib_boot_decide(const float measured_radps[3], const float stored_radps[3],
			  float *delta_dps);

#ifdef __cplusplus
}
#endif

#endif /* BV_CALIB_BOOT_H_ */
