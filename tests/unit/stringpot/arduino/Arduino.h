/* SPDX-License-Identifier: Apache-2.0 */
/* Declarations of what stringpot.ino calls, as the ESP32 core 3 has them: for a syntax check. */
#pragma once
#include <cstddef>
#include <cstdint>

#define ARDUINO_ISR_ATTR
#define pdFALSE 0
#define pdTRUE 1
#define portMAX_DELAY 0xffffffffU
#define configMAX_PRIORITIES 25
#define portYIELD_FROM_ISR() ((void)0)

typedef int BaseType_t;
typedef unsigned UBaseType_t;
typedef struct tskTaskControlBlock *TaskHandle_t;
typedef struct timer_struct_t hw_timer_t;
typedef enum { ADC_0db, ADC_2_5db, ADC_6db, ADC_11db } adc_attenuation_t;

unsigned long micros();
void delay(uint32_t ms);
uint16_t analogRead(uint8_t pin);
void analogReadResolution(uint8_t bits);
void analogSetPinAttenuation(uint8_t pin, adc_attenuation_t attenuation);
hw_timer_t *timerBegin(uint32_t frequency);
void timerAttachInterrupt(hw_timer_t *timer, void (*function)());
void timerAlarm(hw_timer_t *timer, uint64_t value, bool autoreload, uint64_t reload_count);
uint32_t ulTaskNotifyTake(BaseType_t clear, uint32_t ticks);
void vTaskNotifyGiveFromISR(TaskHandle_t task, BaseType_t *woken);
BaseType_t xTaskCreatePinnedToCore(void (*code)(void *), const char *name, uint32_t stack,
				   void *argument, UBaseType_t priority, TaskHandle_t *task,
				   BaseType_t core);

struct HardwareSerial {
	size_t setTxBufferSize(size_t size);
	void begin(unsigned long baud);
	size_t print(const char *text);
	size_t write(const uint8_t *data, size_t size);
};
extern HardwareSerial Serial;
