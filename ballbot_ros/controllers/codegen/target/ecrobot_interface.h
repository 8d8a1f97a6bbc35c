/*
 * The part of the brick's device interface that the generated program uses, for building it
 * without the platform. On the brick the platform's own header takes its place.
 */
#ifndef ECROBOT_INTERFACE_H
#define ECROBOT_INTERFACE_H

#include <stdint.h>

typedef uint8_t U8;
typedef int8_t S8;
typedef uint16_t U16;
typedef int16_t S16;
typedef uint32_t U32;
typedef int32_t S32;
typedef char CHAR;
typedef signed int SINT;

enum { NXT_PORT_A, NXT_PORT_B, NXT_PORT_C };
enum { NXT_PORT_S1, NXT_PORT_S2, NXT_PORT_S3, NXT_PORT_S4 };

U16 ecrobot_get_gyro_sensor(U8 port);
S32 ecrobot_get_motor_rev(U8 port);
void ecrobot_set_motor_mode_speed(U8 port, S32 mode, S8 speed);
void ecrobot_init_sonar_sensor(U8 port);
S32 ecrobot_get_sonar_sensor(U8 port);
void ecrobot_term_sonar_sensor(U8 port);
U16 ecrobot_get_battery_voltage(void);
U32 ecrobot_get_systick_ms(void);
void ecrobot_init_bt_slave(const CHAR *pin);
U32 ecrobot_read_bt_packet(U8 *buffer, U32 length);
void ecrobot_bt_adc_data_logger(S8 data1, S8 data2, S16 adc1, S16 adc2, S16 adc3, S16 adc4);
void ecrobot_term_bt_connection(void);
SINT ecrobot_sound_tone(U32 frequency_hz, U32 duration_ms, U32 volume);
void ecrobot_status_monitor(const CHAR *name);

/* Unused, but the platform's header declares it, so no constant can have this name. */
void sound_freq(U32 frequency_hz, U32 duration_ms);

/* Hooks that the program defines. */
void ecrobot_device_initialize(void);
void ecrobot_device_terminate(void);
void user_1ms_isr_type2(void);

#endif
