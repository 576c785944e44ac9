/* SPDX-License-Identifier: Apache-2.0 */
/**
 * @file
 * A model of the LSM6DSOX as its SPI host sees it. Plain C11 with the host's libm; no simulator.
 *
 * Modelled: the register file (writes are remembered, and checked against what each register
 * allows), sampling with the chip's own clock error and drift, full scale, quantisation and
 * saturation, block data update, data ready, the FIFO (level, watermark, slot counter, parity,
 * overrun; bypass, FIFO and continuous mode; batching rates; stop on watermark; configuration
 * change and timestamp words), timestamp, temperature, self-test, turn-on with and without
 * DRDY_MASK, wake-up detection and the INT1 pin.
 *
 * Not modelled: filters and their delay (a sample is the motion at its instant), compression, the
 * sensor hub, tap, 6D, free fall, steps, state machines, INT2. Switching on what is not modelled
 * is reported like a wrong write, so that no test passes by accident.
 *
 * All times are true time, in microseconds as long double, and only go forward. A slot is one tick
 * of the fastest batching rate; it is written into the FIFO at the instant of its sample.
 */
#ifndef BV_LSM6DSOX_CHIP_H_
#define BV_LSM6DSOX_CHIP_H_

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define CHIP_FIFO_WORDS 512U
#define CHIP_WORD_SIZE  7U
#define CHIP_WHO_AM_I   0x6CU

/** What the sensor feels at one instant, in the sensor's axes. */
struct chip_motion {
	double accel_mps2[3];
	double gyro_radps[3];
};

/** Flags of a slot. */
enum chip_slot_flag {
	CHIP_SLOT_GYRO_SETTLED = 1,
	CHIP_SLOT_ACCEL_SETTLED = 2,
	CHIP_SLOT_CLIPPED = 4,
	CHIP_SLOT_IN_FIFO = 8,
};

/** Truth about one slot: what the chip sampled and when. */
struct chip_slot {
	/** Counts starts of sampling. */
	uint32_t run;
	/** Counts slots of the run. */
	uint32_t slot;
	long double t_us_true;
	int16_t gyro_lsb[3];
	int16_t accel_lsb[3];
	uint8_t accel_fs_g;
	uint8_t flags;
	uint16_t gyro_fs_dps;
};

/** How this chip differs from the next, and whom it talks to. */
struct chip_config {
	/** Relative error of the chip's oscillator. */
	double rate_error;
	/** Its growth per second, from rate_drift_from_us on. */
	double rate_drift_per_s;
	long double rate_drift_from_us;
	/** Die temperature at time 0, deg C, and its growth per second. */
	double temperature_degc;
	double temperature_ramp_degc_per_s;
	/** From switching a sensor on to its first settled sample, us. */
	double gyro_turn_on_us;
	double accel_turn_on_us;
	/** Each slot's counts carry its number instead of the motion; see chip_pattern(). */
	bool pattern;
	void *context;
	/** The motion at a time; may be NULL for a chip lying flat (+1 g on z). */
	void (*motion)(void *context, long double t_us_true, struct chip_motion *motion);
	/** Called for each slot, FIFO or not; may be NULL. */
	void (*slot)(void *context, const struct chip_slot *slot);
	/** Called for each thing the host did that the chip does not allow; may be NULL. */
	void (*violation)(void *context, const char *text);
};

struct chip_stats {
	uint64_t slots;
	uint64_t words_written;
	uint64_t words_read;
	uint64_t words_overwritten;
	/** Words discarded by a change to bypass mode or a reset. */
	uint64_t words_flushed;
	/** Words read when there were none. */
	uint64_t words_empty;
	uint32_t violations;
};

struct chip;

/** @return a chip in its power-on state, or NULL when there is no memory. */
struct chip *chip_new(const struct chip_config *config);
void chip_free(struct chip *chip);

/** Counts of slot @p slot of run @p run when config.pattern is set. */
void chip_pattern(uint32_t run, uint32_t slot, int16_t gyro_lsb[3], int16_t accel_lsb[3]);

/** The supply fails for a moment: registers and FIFO are as at power-on. */
void chip_power_cycle(struct chip *chip);

/** From now on the chip's clock is off by @p rate_error and @p drift_per_s per second. */
void chip_set_clock(struct chip *chip, double rate_error, double drift_per_s);

/** From now on play the pattern, or not. */
void chip_set_pattern(struct chip *chip, bool pattern);

/** Do all that happens up to and including @p t_us_true. */
void chip_advance(struct chip *chip, long double t_us_true);

/** True time of the next sample; INFINITY when none will come. */
long double chip_next_us(const struct chip *chip);

/** Level of the INT1 pin. */
bool chip_int1(const struct chip *chip);

/** Chip select goes active. */
void chip_select(struct chip *chip);
/** One byte each way, at the time last given to chip_advance(). */
uint8_t chip_exchange(struct chip *chip, uint8_t mosi);
/** Chip select goes inactive. */
void chip_deselect(struct chip *chip);

/** Rate of FIFO slots per second; 0 when none are made. */
double chip_slot_rate_hz(const struct chip *chip);

/** Words in the FIFO. */
size_t chip_level(const struct chip *chip);

/** Watermark programmed, words; 0 when none. */
size_t chip_watermark(const struct chip *chip);

const struct chip_stats *chip_get_stats(const struct chip *chip);

#ifdef __cplusplus
}
#endif

#endif /* BV_LSM6DSOX_CHIP_H_ */
