/* SPDX-License-Identifier: Apache-2.0 */
/*
 * String potentiometer on an ESP32: 1,000 lines "time_us,raw_adc" a second at 921,600 baud.
 *
 * A hardware timer gives the pace. Its interrupt keeps the time and wakes a task of its own on
 * core 0 that converts; loop(), on core 1, writes the lines. Needs the Arduino core for the ESP32,
 * version 3 (timerBegin takes a frequency).
 */
#include <Arduino.h>

#include "stringpot_core.h"

static const uint8_t ADC_PIN = 34; /* ADC1: works beside Wi-Fi, input only */
static const uint32_t BAUD = 921600;

static hw_timer_t *timer;
static TaskHandle_t sampler;
static volatile uint32_t tick_us;
static stringpot::Queue<512> queue;
static stringpot::Pacer pacer;

static void ARDUINO_ISR_ATTR on_timer()
{
	BaseType_t woken = pdFALSE;

	tick_us = static_cast<uint32_t>(micros());
	vTaskNotifyGiveFromISR(sampler, &woken);
	if (woken == pdTRUE) {
		portYIELD_FROM_ISR();
	}
}

static void sample_forever(void *unused)
{
	(void)unused;
	for (;;) {
		const uint32_t pending = ulTaskNotifyTake(pdTRUE, portMAX_DELAY);
		const uint32_t time_us = tick_us;

		if (pacer.tick(pending)) {
			queue.push({time_us, stringpot::measure([] { return analogRead(ADC_PIN); })});
		}
	}
}

void setup()
{
	Serial.setTxBufferSize(4096);
	Serial.begin(BAUD);
	analogReadResolution(12);
	analogSetPinAttenuation(ADC_PIN, ADC_11db);
	Serial.print("time_us,raw_adc\r\n");
	xTaskCreatePinnedToCore(sample_forever, "sampler", 4096, nullptr, configMAX_PRIORITIES - 2,
				&sampler, 0);
	timer = timerBegin(1000000);
	timerAttachInterrupt(timer, &on_timer);
	timerAlarm(timer, stringpot::PERIOD_US, true, 0);
}

void loop()
{
	stringpot::Sample sample;
	char line[stringpot::LINE_SIZE];

	while (queue.pop(&sample)) {
		Serial.write(reinterpret_cast<const uint8_t *>(line),
			     stringpot::put_line(line, sample));
	}
	delay(1);
}
