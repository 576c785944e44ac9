/* SPDX-License-Identifier: Apache-2.0 */
#include "chip.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "registers.h"

#define STANDARD_GRAVITY_MPS2 9.80665
#define DEG_PER_RAD           57.29577951308232

/* ODR = 6667 Hz / 2^shift; INTERNAL_FREQ_FINE counts 0.15 % (DS12814, 9.54). */
#define TOP_RATE_HZ           6667.0
#define SHIFT_OFF             255U
#define FREQ_FINE_STEP        0.0015
#define TIMESTAMP_RATE_HZ     40000.0
#define TEMPERATURE_LSB_PER_K 256.0
#define TEMPERATURE_ZERO_DEGC 25.0
#define SW_RESET_US           50.0L
#define BOOT_US               10000.0L

/* Self-test output change, in the middle of what the datasheet allows. */
#define SELF_TEST_ACCEL_MPS2 (0.5 * STANDARD_GRAVITY_MPS2)
#define SELF_TEST_GYRO_RADPS (400.0 / DEG_PER_RAD)

enum { TAG_GYRO = 1, TAG_ACCEL = 2, TAG_TIMESTAMP = 4, TAG_CONFIG_CHANGE = 5 };
enum { MODE_BYPASS = 0, MODE_FIFO = 1, MODE_CONTINUOUS = 6 };
enum { BANK_USER, BANK_EMBEDDED, BANK_SENSOR_HUB, BANKS };

struct chip {
	struct chip_config config;
	struct chip_stats stats;
	long double now_us;

	uint8_t reg[REG_COUNT];
	uint8_t bank[BANKS][REG_COUNT]; /* Only remembered; the first one is not used */

	bool has_address;
	bool reading;
	uint8_t address;

	/* Sampling */
	uint32_t run;
	uint32_t tick; /* Of the faster sensor, in this run */
	uint32_t slot;
	long double next_us;
	long double gyro_on_us;
	long double accel_on_us;
	long double reset_until_us;
	long double boot_until_us;
	long double timestamp_zero_us;

	int16_t gyro_lsb[3];
	int16_t accel_lsb[3];
	uint8_t latched_high;
	bool gyro_ready;
	bool accel_ready;

	/* FIFO */
	uint8_t fifo[CHIP_FIFO_WORDS][CHIP_WORD_SIZE];
	size_t fifo_first;
	size_t fifo_level;
	uint8_t fifo_out[CHIP_WORD_SIZE];
	bool fifo_out_valid;
	bool overrun;
	bool overrun_latched;
	bool config_changed;

	/* Wake-up */
	int16_t wake_last_lsb[3];
	bool wake_has_last;
	uint32_t wake_above;
	bool wake_active;
	uint8_t wake_source;
};

static void violation(struct chip *c, const char *format, ...)
{
	char text[160];
	va_list arguments;

	c->stats.violations++;
	if (c->config.violation == NULL) {
		return;
	}
	va_start(arguments, format);
	vsnprintf(text, sizeof(text), format, arguments);
	va_end(arguments);
	c->config.violation(c->config.context, text);
}

/* --- what the registers say ------------------------------------------------------------------ */

static bool bits(const struct chip *c, uint8_t address, uint8_t mask)
{
	return (c->reg[address] & mask) != 0;
}

static unsigned int odr_shift(unsigned int code, unsigned int shift_of_11)
{
	if (code >= 1 && code <= 10) {
		return 10 - code;
	}
	return code == 11 ? shift_of_11 : SHIFT_OFF;
}

static unsigned int accel_shift(const struct chip *c)
{
	return odr_shift(c->reg[REG_CTRL1_XL] >> 4, 12);
}

static unsigned int gyro_shift(const struct chip *c)
{
	return bits(c, REG_CTRL4_C, 0x40) ? SHIFT_OFF
					  : odr_shift(c->reg[REG_CTRL2_G] >> 4, SHIFT_OFF);
}

static unsigned int larger(unsigned int a, unsigned int b)
{
	return a > b ? a : b;
}

static unsigned int smaller(unsigned int a, unsigned int b)
{
	return a < b ? a : b;
}

/* A sensor is batched no faster than it samples, and not at all when it is off. */
static unsigned int batch_shift(unsigned int asked, unsigned int sampling)
{
	return sampling == SHIFT_OFF || asked == SHIFT_OFF ? SHIFT_OFF : larger(asked, sampling);
}

static unsigned int accel_batch_shift(const struct chip *c)
{
	return batch_shift(odr_shift(c->reg[REG_FIFO_CTRL3] & 0x0F, 12), accel_shift(c));
}

static unsigned int gyro_batch_shift(const struct chip *c)
{
	return batch_shift(odr_shift(c->reg[REG_FIFO_CTRL3] >> 4, 10), gyro_shift(c));
}

static uint8_t fifo_mode(const struct chip *c)
{
	return c->reg[REG_FIFO_CTRL4] & 0x07;
}

static unsigned int accel_fs_g(const struct chip *c)
{
	static const uint8_t full_scale_g[] = {2, 16, 4, 8};

	return full_scale_g[(c->reg[REG_CTRL1_XL] >> 2) & 3];
}

static unsigned int gyro_fs_dps(const struct chip *c)
{
	static const uint16_t full_scale_dps[] = {250, 500, 1000, 2000};

	return bits(c, REG_CTRL2_G, 0x02) ? 125 : full_scale_dps[(c->reg[REG_CTRL2_G] >> 2) & 3];
}

size_t chip_watermark(const struct chip *c)
{
	return c->reg[REG_FIFO_CTRL1] | (size_t)(c->reg[REG_FIFO_CTRL2] & 1) << 8;
}

static size_t fifo_depth(const struct chip *c)
{
	return bits(c, REG_FIFO_CTRL2, 0x80) && chip_watermark(c) > 0 ? chip_watermark(c)
								     : CHIP_FIFO_WORDS;
}

static long double rate_factor(const struct chip *c, long double t_us)
{
	return 1.0L + c->config.rate_error +
	       c->config.rate_drift_per_s * (t_us - c->config.rate_drift_from_us) * 1e-6L;
}

static uint32_t timestamp(const struct chip *c)
{
	const long double t_us = c->now_us - c->timestamp_zero_us;

	return bits(c, REG_CTRL10_C, 0x20)
		       ? (uint32_t)(t_us * 1e-6L * TIMESTAMP_RATE_HZ * rate_factor(c, c->now_us))
		       : 0;
}

/* --- FIFO ------------------------------------------------------------------------------------ */

size_t chip_level(const struct chip *c)
{
	return c->fifo_level;
}

static void fifo_flush(struct chip *c)
{
	c->stats.words_flushed += c->fifo_level;
	c->fifo_level = 0;
	c->fifo_out_valid = false;
	c->overrun = false;
	c->overrun_latched = false;
	c->config_changed = false;
}

static void fifo_drop_oldest(struct chip *c, size_t words)
{
	words = words < c->fifo_level ? words : c->fifo_level;
	c->fifo_first = (c->fifo_first + words) % CHIP_FIFO_WORDS;
	c->fifo_level -= words;
	c->stats.words_overwritten += words;
	c->overrun = true;
	c->overrun_latched = true;
}

static uint8_t tag_byte(unsigned int sensor, uint32_t slot)
{
	uint8_t tag = (uint8_t)(sensor << 3 | (slot & 3) << 1);
	uint8_t ones = 0;

	for (unsigned int bit = 1; bit < 8; bit++) {
		ones ^= (tag >> bit) & 1;
	}
	return tag | ones;
}

static void fifo_put(struct chip *c, unsigned int sensor, uint32_t slot, const uint8_t data[6])
{
	uint8_t *word;

	if (fifo_mode(c) == MODE_BYPASS) {
		return;
	}
	if (c->fifo_level >= fifo_depth(c)) {
		if (fifo_mode(c) == MODE_FIFO) {
			return;
		}
		fifo_drop_oldest(c, c->fifo_level - fifo_depth(c) + 1);
	}
	word = c->fifo[(c->fifo_first + c->fifo_level) % CHIP_FIFO_WORDS];
	word[0] = tag_byte(sensor, slot);
	memcpy(&word[1], data, 6);
	c->fifo_level++;
	c->stats.words_written++;
}

static void fifo_put_axes(struct chip *c, unsigned int sensor, const int16_t axes[3])
{
	uint8_t data[6];

	for (int i = 0; i < 3; i++) {
		data[2 * i] = (uint8_t)((uint16_t)axes[i] & 0xFF);
		data[2 * i + 1] = (uint8_t)((uint16_t)axes[i] >> 8);
	}
	fifo_put(c, sensor, c->slot, data);
}

static void fifo_put_config_change(struct chip *c)
{
	/* Sixth byte: batching rates, as ST's FIFO utility reads them. */
	const uint8_t data[6] = {0, 0, 0, 0, 0, c->reg[REG_FIFO_CTRL3]};

	fifo_put(c, TAG_CONFIG_CHANGE, c->slot, data);
	c->config_changed = false;
}

static void fifo_put_timestamp(struct chip *c)
{
	static const uint8_t decimation[] = {0, 1, 8, 32};
	const unsigned int every = decimation[c->reg[REG_FIFO_CTRL4] >> 6];
	const uint32_t now = timestamp(c);
	const uint8_t data[6] = {(uint8_t)now, (uint8_t)(now >> 8), (uint8_t)(now >> 16),
				 (uint8_t)(now >> 24)};

	/* The slot counter of these words was seen to stay 0 on a related part. */
	if (every != 0 && c->slot % every == 0) {
		fifo_put(c, TAG_TIMESTAMP, 0, data);
	}
}

static void fifo_pop(struct chip *c)
{
	c->fifo_out_valid = false;
	if (c->fifo_level == 0) {
		c->stats.words_empty++;
		return;
	}
	c->fifo_first = (c->fifo_first + 1) % CHIP_FIFO_WORDS;
	c->fifo_level--;
	c->stats.words_read++;
	c->overrun = false;
}

static uint8_t fifo_out(struct chip *c, uint8_t address)
{
	const unsigned int index = address - REG_FIFO_DATA_OUT_TAG;
	uint8_t value;

	if (!c->fifo_out_valid) {
		/* The word is held while it is read, whatever the FIFO does meanwhile. */
		memset(c->fifo_out, 0, sizeof(c->fifo_out));
		if (c->fifo_level > 0) {
			memcpy(c->fifo_out, c->fifo[c->fifo_first], sizeof(c->fifo_out));
		}
		c->fifo_out_valid = true;
	}
	value = c->fifo_out[index];
	if (address == REG_FIFO_DATA_OUT_Z_H) {
		fifo_pop(c);
	}
	return value;
}

static uint8_t fifo_status2(struct chip *c)
{
	const size_t watermark = chip_watermark(c);
	uint8_t value = (uint8_t)(c->fifo_level >> 8);

	value |= watermark > 0 && c->fifo_level >= watermark ? 0x80 : 0;
	value |= c->overrun ? 0x40 : 0;
	value |= c->fifo_level + 2 > fifo_depth(c) ? 0x20 : 0;
	value |= c->overrun_latched ? 0x08 : 0;
	c->overrun_latched = false;
	return value;
}

/* --- sampling -------------------------------------------------------------------------------- */

void chip_pattern(uint32_t run, uint32_t slot, int16_t gyro_lsb[3], int16_t accel_lsb[3])
{
	gyro_lsb[0] = (int16_t)(slot & 0x3FFF);
	gyro_lsb[1] = (int16_t)(slot >> 14 & 0x3FFF);
	gyro_lsb[2] = (int16_t)(run & 0x3FFF);
	for (int i = 0; i < 3; i++) {
		accel_lsb[i] = (int16_t)(-1 - gyro_lsb[i]);
	}
}

static int16_t quantise(double value, double lsb, bool *clipped)
{
	const double counts = rint(value / lsb);

	if (counts > 32767.0 || counts < -32768.0 || isnan(counts)) {
		*clipped = true;
		return counts < 0.0 ? -32768 : 32767;
	}
	return (int16_t)counts;
}

static double self_test_sign(const struct chip *c, unsigned int shift, unsigned int negative)
{
	const unsigned int code = (c->reg[REG_CTRL5_C] >> shift) & 3;

	return code == 1 ? 1.0 : code == negative ? -1.0 : 0.0;
}

static void measure(struct chip *c, struct chip_slot *s)
{
	const double accel_lsb_mps2 =
		accel_fs_g(c) / 2.0 * 0.061e-3 * STANDARD_GRAVITY_MPS2;
	const double gyro_lsb_radps = gyro_fs_dps(c) / 125.0 * 4.375e-3 / DEG_PER_RAD;
	struct chip_motion motion = {.accel_mps2 = {0.0, 0.0, STANDARD_GRAVITY_MPS2}};
	bool clipped = false;

	if (c->config.pattern) {
		chip_pattern(s->run, s->slot, s->gyro_lsb, s->accel_lsb);
		return;
	}
	if (c->config.motion != NULL) {
		c->config.motion(c->config.context, s->t_us_true, &motion);
	}
	for (int i = 0; i < 3; i++) {
		s->accel_lsb[i] = quantise(motion.accel_mps2[i] +
						   self_test_sign(c, 0, 2) * SELF_TEST_ACCEL_MPS2,
					   accel_lsb_mps2, &clipped);
		s->gyro_lsb[i] = quantise(motion.gyro_radps[i] +
						  self_test_sign(c, 2, 3) * SELF_TEST_GYRO_RADPS,
					  gyro_lsb_radps, &clipped);
	}
	s->flags |= clipped ? CHIP_SLOT_CLIPPED : 0;
}

/* Until a sensor has settled its counts are marked, when asked for, or else plain wrong. */
static void spoil(const struct chip *c, int16_t axes[3], bool is_gyro, double settled_part)
{
	for (int i = 0; i < 3; i++) {
		if (bits(c, REG_CTRL4_C, 0x08)) {
			axes[i] = (int16_t)(is_gyro ? 0x7FFF - i : 0x7FFF);
		} else {
			axes[i] = (int16_t)(20000.0 * (1.0 - settled_part)) ^ axes[i];
		}
	}
}

static double settled_part(long double now_us, long double on_us, double turn_on_us)
{
	return turn_on_us > 0.0 ? fmin(1.0, (double)(now_us - on_us) / turn_on_us) : 1.0;
}

static void detect_wake_up(struct chip *c)
{
	const unsigned int per_step_lsb = bits(c, REG_WAKE_UP_DUR, 0x10) ? 128 : 512;
	const int threshold_lsb = (int)((c->reg[REG_WAKE_UP_THS] & 0x3F) * per_step_lsb);
	const uint32_t duration = (c->reg[REG_WAKE_UP_DUR] >> 5) & 3;
	uint8_t axes = 0;

	for (int i = 0; i < 3; i++) {
		const int slope_lsb = (c->accel_lsb[i] - c->wake_last_lsb[i]) / 2;

		axes |= c->wake_has_last && abs(slope_lsb) > threshold_lsb ? 4 >> i : 0;
	}
	memcpy(c->wake_last_lsb, c->accel_lsb, sizeof(c->wake_last_lsb));
	c->wake_has_last = true;
	c->wake_above = axes != 0 ? c->wake_above + 1 : 0;
	if (bits(c, REG_TAP_CFG2, 0x80) && c->wake_above > duration) {
		c->wake_active = true;
		c->wake_source = 0x08 | axes;
	} else if (!bits(c, REG_TAP_CFG0, 0x01)) {
		c->wake_active = false;
		c->wake_source = 0;
	}
}

static bool is_due(uint32_t tick, unsigned int shift, unsigned int base_shift)
{
	return shift != SHIFT_OFF && (tick & ((1UL << (shift - base_shift)) - 1)) == 0;
}

static void take_sample(struct chip *c)
{
	const unsigned int base = smaller(accel_shift(c), gyro_shift(c));
	const unsigned int slot_shift = smaller(accel_batch_shift(c), gyro_batch_shift(c));
	const double gyro_settled =
		settled_part(c->now_us, c->gyro_on_us, c->config.gyro_turn_on_us);
	const double accel_settled =
		settled_part(c->now_us, c->accel_on_us, c->config.accel_turn_on_us);
	const bool mask = bits(c, REG_CTRL4_C, 0x08);
	struct chip_slot s = {
		.run = c->run,
		.slot = c->slot,
		.t_us_true = c->now_us,
		.accel_fs_g = (uint8_t)accel_fs_g(c),
		.gyro_fs_dps = (uint16_t)gyro_fs_dps(c),
	};

	measure(c, &s);
	if (gyro_settled < 1.0) {
		spoil(c, s.gyro_lsb, true, gyro_settled);
	}
	if (accel_settled < 1.0) {
		spoil(c, s.accel_lsb, false, accel_settled);
	}
	if (is_due(c->tick, gyro_shift(c), base)) {
		memcpy(c->gyro_lsb, s.gyro_lsb, sizeof(c->gyro_lsb));
		c->gyro_ready = gyro_settled >= 1.0 || !mask;
	}
	if (is_due(c->tick, accel_shift(c), base)) {
		memcpy(c->accel_lsb, s.accel_lsb, sizeof(c->accel_lsb));
		c->accel_ready = accel_settled >= 1.0 || !mask;
		detect_wake_up(c);
	}
	if (is_due(c->tick, slot_shift == SHIFT_OFF ? base : slot_shift, base)) {
		if (c->config_changed) {
			fifo_put_config_change(c);
		}
		if (is_due(c->tick, gyro_batch_shift(c), base)) {
			fifo_put_axes(c, TAG_GYRO, s.gyro_lsb);
		}
		if (is_due(c->tick, accel_batch_shift(c), base)) {
			fifo_put_axes(c, TAG_ACCEL, s.accel_lsb);
		}
		if (slot_shift != SHIFT_OFF) {
			fifo_put_timestamp(c);
		}
		s.flags |= gyro_settled >= 1.0 ? CHIP_SLOT_GYRO_SETTLED : 0;
		s.flags |= accel_settled >= 1.0 ? CHIP_SLOT_ACCEL_SETTLED : 0;
		s.flags |= fifo_mode(c) != MODE_BYPASS && slot_shift != SHIFT_OFF
				   ? CHIP_SLOT_IN_FIFO
				   : 0;
		if (c->config.slot != NULL) {
			c->config.slot(c->config.context, &s);
		}
		c->stats.slots++;
		c->slot++;
	}
	c->tick++;
}

static long double sample_period_us(const struct chip *c, long double at_us)
{
	const unsigned int base = smaller(accel_shift(c), gyro_shift(c));

	return ldexpl(1e6L / (TOP_RATE_HZ * rate_factor(c, at_us)), (int)base);
}

/* A sensor was switched on, off or to another rate: sampling starts anew. */
static void restart_sampling(struct chip *c)
{
	c->tick = 0;
	c->slot = 0;
	c->wake_has_last = false;
	if (smaller(accel_shift(c), gyro_shift(c)) == SHIFT_OFF) {
		c->next_us = INFINITY;
		return;
	}
	c->run++;
	c->next_us = c->now_us + sample_period_us(c, c->now_us);
}

double chip_slot_rate_hz(const struct chip *c)
{
	const unsigned int shift = smaller(accel_batch_shift(c), gyro_batch_shift(c));

	return shift == SHIFT_OFF ? 0.0 : ldexp(TOP_RATE_HZ, -(int)shift);
}

void chip_advance(struct chip *c, long double t_us_true)
{
	while (c->next_us <= t_us_true) {
		c->now_us = c->next_us;
		take_sample(c);
		c->next_us += sample_period_us(c, c->next_us);
	}
	if (t_us_true > c->now_us) {
		c->now_us = t_us_true;
	}
}

long double chip_next_us(const struct chip *c)
{
	return c->next_us;
}

bool chip_int1(const struct chip *c)
{
	const size_t watermark = chip_watermark(c);
	const uint8_t route = c->reg[REG_INT1_CTRL];
	bool active = false;

	active |= (route & 0x01) != 0 && c->accel_ready;
	active |= (route & 0x02) != 0 && c->gyro_ready;
	active |= (route & 0x08) != 0 && watermark > 0 && c->fifo_level >= watermark;
	active |= (route & 0x10) != 0 && c->overrun;
	active |= (route & 0x20) != 0 && c->fifo_level + 2 > fifo_depth(c);
	active |= bits(c, REG_MD1_CFG, 0x20) && c->wake_active;
	return active != bits(c, REG_CTRL3_C, 0x20);
}

/* --- registers ------------------------------------------------------------------------------- */

static void reset_registers(struct chip *c)
{
	memset(c->reg, 0, sizeof(c->reg));
	memset(c->bank, 0, sizeof(c->bank));
	for (unsigned int address = 0; address < REG_COUNT; address++) {
		const struct register_rule *rule = register_rule((uint8_t)address);

		c->reg[address] = rule != NULL ? rule->reset : 0;
	}
	c->reg[REG_WHO_AM_I] = CHIP_WHO_AM_I;
	c->reg[REG_INTERNAL_FREQ_FINE] =
		(uint8_t)(int8_t)fmax(-128.0, fmin(127.0, rint(c->config.rate_error /
							       FREQ_FINE_STEP)));
	fifo_flush(c);
	c->gyro_ready = false;
	c->accel_ready = false;
	c->wake_active = false;
	c->wake_source = 0;
	c->wake_above = 0;
	restart_sampling(c);
}

static unsigned int current_bank(const struct chip *c)
{
	const uint8_t access = c->reg[REG_FUNC_CFG_ACCESS];

	return (access & 0x80) != 0 ? BANK_EMBEDDED
				    : (access & 0x40) != 0 ? BANK_SENSOR_HUB : BANK_USER;
}

static uint8_t low_then_high(struct chip *c, uint8_t address, int16_t value)
{
	const uint8_t high = (uint8_t)((uint16_t)value >> 8);

	if ((address & 1) == 0) {
		c->latched_high = high;
		return (uint8_t)((uint16_t)value & 0xFF);
	}
	/* Block data update: the high byte belongs to the low byte that was read. */
	return bits(c, REG_CTRL3_C, 0x40) ? c->latched_high : high;
}

static int16_t temperature_lsb(const struct chip *c)
{
	const double degc = c->config.temperature_degc +
			    c->config.temperature_ramp_degc_per_s * (double)c->now_us * 1e-6;
	bool clipped = false;

	return quantise(degc - TEMPERATURE_ZERO_DEGC, 1.0 / TEMPERATURE_LSB_PER_K, &clipped);
}

static uint8_t read_output(struct chip *c, uint8_t address)
{
	uint8_t value;

	if (address < REG_OUTX_L_G) {
		return low_then_high(c, address, temperature_lsb(c));
	}
	if (address < REG_OUTX_L_A) {
		value = low_then_high(c, address, c->gyro_lsb[(address - REG_OUTX_L_G) / 2]);
		c->gyro_ready = c->gyro_ready && (address & 1) == 0;
		return value;
	}
	value = low_then_high(c, address, c->accel_lsb[(address - REG_OUTX_L_A) / 2]);
	c->accel_ready = c->accel_ready && (address & 1) == 0;
	return value;
}

static uint8_t read_wake_up_source(struct chip *c)
{
	const uint8_t value = c->wake_source;

	c->wake_active = false;
	c->wake_source = 0;
	return value;
}

static uint8_t read_register(struct chip *c, uint8_t address)
{
	if (address == REG_FUNC_CFG_ACCESS) {
		return c->reg[address];
	}
	if (current_bank(c) != BANK_USER) {
		return c->bank[current_bank(c)][address];
	}
	if (!register_readable(address)) {
		violation(c, "read of reserved register 0x%02X", address);
		return 0;
	}
	if (address >= REG_OUT_TEMP_L && address <= REG_OUTZ_H_A) {
		return read_output(c, address);
	}
	if (address >= REG_FIFO_DATA_OUT_TAG && address <= REG_FIFO_DATA_OUT_Z_H) {
		return fifo_out(c, address);
	}
	if (address >= REG_TIMESTAMP0 && address <= REG_TIMESTAMP3) {
		return (uint8_t)(timestamp(c) >> 8 * (address - REG_TIMESTAMP0));
	}
	switch (address) {
	case REG_CTRL3_C:
		return c->reg[address] | (c->now_us < c->reset_until_us ? 0x01 : 0) |
		       (c->now_us < c->boot_until_us ? 0x80 : 0);
	case REG_ALL_INT_SRC:
		return c->wake_active ? 0x02 : 0;
	case REG_WAKE_UP_SRC:
		return read_wake_up_source(c);
	case REG_STATUS_REG:
		return (uint8_t)((c->accel_ready ? 1 : 0) | (c->gyro_ready ? 2 : 0) | 4);
	case REG_FIFO_STATUS1:
		return (uint8_t)c->fifo_level;
	case REG_FIFO_STATUS2:
		return fifo_status2(c);
	default:
		return c->reg[address];
	}
}

static void check_fifo(struct chip *c)
{
	const unsigned int bdr_xl = odr_shift(c->reg[REG_FIFO_CTRL3] & 0x0F, 12);
	const unsigned int bdr_gy = odr_shift(c->reg[REG_FIFO_CTRL3] >> 4, 10);
	const uint8_t mode = fifo_mode(c);

	if (mode == MODE_BYPASS) {
		return;
	}
	if (mode != MODE_FIFO && mode != MODE_CONTINUOUS) {
		violation(c, "FIFO_CTRL4: mode %u is reserved or not modelled", mode);
	}
	if (bdr_xl == SHIFT_OFF && bdr_gy == SHIFT_OFF) {
		violation(c, "FIFO_CTRL4: FIFO on with nothing batched (FIFO_CTRL3 is 0x%02X)",
			  c->reg[REG_FIFO_CTRL3]);
	}
	if ((bdr_xl != SHIFT_OFF && bdr_xl < accel_shift(c)) ||
	    (bdr_gy != SHIFT_OFF && bdr_gy < gyro_shift(c))) {
		violation(c, "FIFO_CTRL3: a sensor is batched faster than it samples");
	}
	if (bits(c, REG_INT1_CTRL, 0x08) && chip_watermark(c) == 0) {
		violation(c, "INT1_CTRL: watermark interrupt without a watermark");
	}
}

static void apply(struct chip *c, uint8_t address, uint8_t before)
{
	const uint8_t now = c->reg[address];

	switch (address) {
	case REG_CTRL1_XL:
		if ((now & 0xF0) != (before & 0xF0)) {
			c->accel_on_us = before >> 4 == 0 ? c->now_us : c->accel_on_us;
			restart_sampling(c);
		}
		c->config_changed |= bits(c, REG_FIFO_CTRL2, 0x10) && now != before;
		break;
	case REG_CTRL2_G:
		if ((now & 0xF0) != (before & 0xF0)) {
			c->gyro_on_us = before >> 4 == 0 ? c->now_us : c->gyro_on_us;
			restart_sampling(c);
		}
		c->config_changed |= bits(c, REG_FIFO_CTRL2, 0x10) && now != before;
		break;
	case REG_CTRL3_C:
		if ((now & 0x01) != 0) {
			c->reset_until_us = c->now_us + SW_RESET_US;
			reset_registers(c);
		} else if ((now & 0x80) != 0) {
			c->boot_until_us = c->now_us + BOOT_US;
		}
		c->reg[address] &= (uint8_t)~0x81;
		break;
	case REG_FIFO_CTRL3:
		c->config_changed |= bits(c, REG_FIFO_CTRL2, 0x10) && now != before;
		check_fifo(c);
		break;
	case REG_FIFO_CTRL4:
		if (fifo_mode(c) == MODE_BYPASS || (before & 7) == MODE_BYPASS) {
			fifo_flush(c);
		}
		check_fifo(c);
		break;
	case REG_CTRL10_C:
		if ((now & 0x20) != 0 && (before & 0x20) == 0) {
			c->timestamp_zero_us = c->now_us;
		}
		break;
	case REG_TIMESTAMP2:
		if (now == 0xAA) {
			c->timestamp_zero_us = c->now_us;
		}
		break;
	case REG_INT1_CTRL:
		check_fifo(c);
		break;
	default:
		break;
	}
}

static void write_register(struct chip *c, uint8_t address, uint8_t value)
{
	const struct register_rule *rule = register_rule(address);
	const uint8_t before = c->reg[address];

	if (c->now_us < c->reset_until_us) {
		violation(c, "write of 0x%02X to register 0x%02X during the software reset", value,
			  address);
		return;
	}
	if (current_bank(c) != BANK_USER && address != REG_FUNC_CFG_ACCESS) {
		c->bank[current_bank(c)][address] = value;
		return;
	}
	if (rule == NULL) {
		violation(c, "write of 0x%02X to register 0x%02X, which is read-only or reserved",
			  value, address);
		return;
	}
	if (((value ^ rule->reset) & (uint8_t)~rule->writable) != 0) {
		violation(c, "write of 0x%02X to %s changes reserved bits 0x%02X", value,
			  rule->name, (uint8_t)((value ^ rule->reset) & ~rule->writable));
		value = (uint8_t)((value & rule->writable) | (rule->reset & ~rule->writable));
	}
	if (((value ^ rule->reset) & rule->unmodelled) != 0) {
		violation(c, "write of 0x%02X to %s switches on what is not modelled (bits 0x%02X)",
			  value, rule->name, (uint8_t)((value ^ rule->reset) & rule->unmodelled));
	}
	c->reg[address] = value;
	apply(c, address, before);
}

/* --- bus ------------------------------------------------------------------------------------- */

void chip_select(struct chip *c)
{
	c->has_address = false;
}

uint8_t chip_exchange(struct chip *c, uint8_t mosi)
{
	uint8_t miso = 0xFF;

	if (!c->has_address) {
		c->has_address = true;
		c->reading = (mosi & 0x80) != 0;
		c->address = mosi & 0x7F;
		return miso;
	}
	if (c->reading) {
		/* In three-wire mode the chip answers on the other line. */
		miso = bits(c, REG_CTRL3_C, 0x08) ? 0xFF : read_register(c, c->address);
	} else {
		write_register(c, c->address, mosi);
	}
	if (bits(c, REG_CTRL3_C, 0x04)) {
		c->address = c->address == REG_FIFO_DATA_OUT_Z_H && current_bank(c) == BANK_USER
				     ? REG_FIFO_DATA_OUT_TAG
				     : (c->address + 1) & 0x7F;
	}
	return miso;
}

void chip_deselect(struct chip *c)
{
	c->has_address = false;
}

struct chip *chip_new(const struct chip_config *config)
{
	struct chip *c = calloc(1, sizeof(*c));

	if (c != NULL) {
		c->config = *config;
		c->reset_until_us = -1.0L;
		c->boot_until_us = -1.0L;
		reset_registers(c);
		c->run = 0;
	}
	return c;
}

void chip_power_cycle(struct chip *c)
{
	c->has_address = false;
	reset_registers(c);
}

void chip_set_clock(struct chip *c, double rate_error, double drift_per_s)
{
	c->config.rate_error = rate_error;
	c->config.rate_drift_per_s = drift_per_s;
	c->config.rate_drift_from_us = c->now_us;
}

void chip_set_pattern(struct chip *c, bool pattern)
{
	c->config.pattern = pattern;
}

void chip_free(struct chip *c)
{
	free(c);
}

const struct chip_stats *chip_get_stats(const struct chip *c)
{
	return &c->stats;
}
