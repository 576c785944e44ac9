/* SPDX-License-Identifier: Apache-2.0 */
/**
 * @file
 * The chip model on the simulated board: the two calls that the emulated SPI bus makes.
 *
 * They cross from the embedded image into the runner, which is a host program with its own C
 * library; only plain integers and byte buffers may cross.
 *
 * Options of the executable:
 *
 *   -imu_motion=FILE         motion to play, see motion.h; without it the chip lies flat
 *   -imu_hands=PIPE          held and turned by whoever writes to this pipe, see hands.h
 *   -imu_pattern             each sample carries its slot number instead of motion
 *   -imu_noise=A:G           white noise added to each sample: m/s^2 and rad/s, rms
 *   -imu_seed=N              of the noise and of the random faults
 *   -imu_rate_error=E        relative error of the chip's clock, e.g. -0.068
 *   -imu_rate_drift=D        its growth per second
 *   -imu_temperature=T       die temperature, deg C (25)
 *   -imu_temperature_ramp=R  its growth, deg C per second
 *   -imu_fault=FAULTS        see fault.h
 *   -imu_lenient             a forbidden access is reported and does not end the run
 *   -imu_truth=FILE          what was sampled and when, see below
 *   -imu_edges=FILE          INT1 pin, in the form of -gpio_out_file
 *   -imu_stats=FILE          counts of the whole run, JSON, written at the end
 *
 * Truth file, little-endian: the eight characters "BVIMUTRU", version u32 (1), record size u32 (40),
 * then one record per slot, whether or not it went into the FIFO:
 *
 *   offset  0  u32     run: counts starts of sampling
 *           4  u32     slot: counts slots of the run
 *           8  f64     time of the sample, true time, us
 *          16  f64     the same instant on the node's own clock, us (16 ticks each)
 *          24  i16[3]  angular rate, counts
 *          30  i16[3]  specific force, counts
 *          36  u8      accelerometer full scale, g
 *          37  u8      flags: 1 gyroscope settled, 2 accelerometer settled, 4 clipped, 8 in FIFO
 *          38  u16     gyroscope full scale, dps
 */
#ifndef BV_LSM6DSOX_MODEL_H_
#define BV_LSM6DSOX_MODEL_H_

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/** Tell the model where INT1 is wired and how fast the bus is clocked. */
void lsm6dsox_model_attach(unsigned int int1_port, unsigned int int1_pin, uint32_t spi_hz);

/**
 * Move bytes in both directions at the present simulated time.
 *
 * @param first chip select went active just before.
 * @param last chip select goes inactive just after.
 */
void lsm6dsox_model_transfer(const uint8_t *mosi, uint8_t *miso, size_t size, bool first,
			     bool last);

/* What a test inside the image may ask of the model. */

/** One slot, as in the truth file; the flags are those of chip.h. */
struct lsm6dsox_model_slot {
	uint32_t run;
	uint32_t slot;
	double t_us_local;
	int16_t gyro_lsb[3];
	int16_t accel_lsb[3];
	uint8_t flags;
};

/** Slots that lsm6dsox_model_truth() remembers. */
#define LSM6DSOX_MODEL_HISTORY 4096U

/** Slot @p slot of the present run. @return false when it is not remembered. */
bool lsm6dsox_model_truth(uint32_t slot, struct lsm6dsox_model_slot *truth);

/** Simulated local time, us. */
uint64_t lsm6dsox_model_now_us(void);

/** The chip's supply fails for a moment. */
void lsm6dsox_model_power_cycle(void);

/** As -imu_rate_error and -imu_rate_drift, from now on. */
void lsm6dsox_model_set_clock(double rate_error, double drift_per_s);

/** As -imu_fault, instead of all faults before; START counts from now. NULL for none. */
void lsm6dsox_model_set_faults(const char *faults);

/** As -imu_pattern. */
void lsm6dsox_model_set_pattern(bool pattern);

/** Specific force and angular rate from now on, instead of a motion file. */
void lsm6dsox_model_set_motion(const double accel_mps2[3], const double gyro_radps[3]);

/** Whether a forbidden access ends the run. @return forbidden accesses so far. */
uint32_t lsm6dsox_model_set_strict(bool strict);

/** How long the next transfer is held up before it begins, by the fault "overrun". */
uint32_t lsm6dsox_model_stall_ms(void);

#ifdef __cplusplus
}
#endif

#endif /* BV_LSM6DSOX_MODEL_H_ */
