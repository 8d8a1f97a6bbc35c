/*
 * The ballbot's control program: task_init, task_ts1, task_ts2, task_ts3.
 *
 * {{ stamp }}
 *
 * All float operations are IEEE single precision, in the same order as in the simulated
 * controller, so that the duties agree bit for bit. On a processor with fused multiply-add, compile
 * with -ffp-contract=off; the brick's processor has none. Only the rounding of the logged pitch
 * uses doubles.
 */
#include <math.h>

#include "kernel.h"
#include "kernel_id.h"
#include "ecrobot_interface.h"

#include "ballbot_controller.h"
#include "ballbot_parameters.h"

#define GYRO_X NXT_PORT_S1
#define GYRO_Y NXT_PORT_S2
#define SONAR NXT_PORT_S3
#define MOTOR_X NXT_PORT_B
#define MOTOR_Y NXT_PORT_C
#define BRAKE 1

/* Values of log_content from which a log packet has duties, and readings of the gyros. */
#define LOG_DUTIES {{ log_duties }}U
#define LOG_GYROS {{ log_gyros }}U

#define NO_ECHO_CM {{ no_echo_cm }}
#define LOWEST_TONE_HZ {{ lowest_tone_hz }}U
#define DISTANCE_TONE_MS {{ periods.task_ts3 }}U
#define PACKET_SIZE {{ packet_size }}U

/* Motor voltage at full duty [V] by battery voltage [mV], equation (6.1). */
#define VOLTAGE_SLOPE {{ voltage_slope }}
#define VOLTAGE_OFFSET {{ voltage_offset }}

/*
 * No initializer: STOP and RUN restart the program without reloading its data. task_init sets
 * every member.
 */
BallbotState ballbot;

/* Sets every member of a plane to its initial value. */
static void reset(BallbotPlane *plane)
{
{% for variable in plane_variables %}
    plane->{{ variable.name }} = {{ variable.initial }};
{% endfor %}
}

/* Moves the offset estimate towards a reading at rest. */
static void calibrate(BallbotPlane *plane, U16 gyro)
{
    plane->gyro_offset = ((float)gyro * (1.0f - a_gc)) + (a_gc * plane->gyro_offset);
}

/* Returns a duty within -100 ... 100 %, truncated toward zero. */
static S8 whole_duty(float duty)
{
    S8 percent;

    if (isnan(duty) != 0) {
        /* No voltage and no error (0/0), or no voltage and no gain. */
        percent = 0;
    } else if (duty > 100.0f) {
        percent = 100;
    } else if (duty < -100.0f) {
        percent = -100;
    } else {
        percent = (S8)duty;
    }
    return percent;
}

/* Balance and drive of one plane (section 7.4): returns the duty [%]. */
static S8 control(BallbotPlane *plane, U16 gyro, S32 revolution, S32 stick, float max_voltage)
{
    /* Speed command through a low pass, and its integral. */
    const float theta_ref = ts1 * plane->sum_theta_ref_dot / 1000.0f;
    const float theta_ref_dot = ((float)stick / (float)gp_max * k_thetadot * (1.0f - a_r))
                                + (plane->theta_ref_dot * a_r);

    /* Estimates: pitch from the gyro, ball angle from encoder and pitch. */
    const float reading = (float)gyro;
    const float psi = ts1 * plane->sum_psi_dot / 1000.0f;
    const float theta = (wheel_radius / ball_radius * (float)revolution) + psi;
    const float theta_smooth = (theta * (1.0f - a_d)) + (plane->theta_smooth * a_d);
    const float gyro_offset = (reading * (1.0f - a_gd)) + (a_gd * plane->gyro_offset);
    const float psi_dot = reading - gyro_offset;
    const float theta_dot = (theta_smooth - plane->theta_smooth) * 1000.0f / ts1;

    /* State feedback and integral; the pitch reference is zero. */
    const float theta_diff = theta_ref - theta;
    const float psi_diff = 0.0f - psi;
    const float integral = ts1 * plane->sum_theta_diff / 1000.0f * k_i;
    float feedback = 0.0f;
    float duty;
    float sign = 0.0f;

    feedback = feedback + (k_f[0] * theta_diff);
    feedback = feedback + (k_f[1] * psi_diff);
    feedback = feedback + (k_f[2] * (theta_ref_dot - theta_dot));
    feedback = feedback + (k_f[3] * (0.0f - psi_dot));
    duty = (integral + feedback) / max_voltage * 100.0f;

    /* Friction compensation. */
    if (duty > 0.0f) {
        sign = 1.0f;
    } else if (duty < 0.0f) {
        sign = -1.0f;
    } else {
        /* A duty of zero stays zero. */
    }
    duty = (pwm_offset * sign) + (pwm_gain * duty);

    plane->gyro_offset = gyro_offset;
    plane->theta = theta;
    plane->psi = psi;
    plane->theta_dot = theta_dot;
    plane->psi_dot = psi_dot;
    plane->theta_ref = theta_ref;
    plane->theta_ref_dot = theta_ref_dot;
    plane->theta_diff = theta_diff;
    plane->psi_diff = psi_diff;
    plane->sum_theta_ref_dot = theta_ref_dot + plane->sum_theta_ref_dot;
    plane->sum_psi_dot = psi_dot + plane->sum_psi_dot;
    plane->sum_theta_diff = theta_diff + plane->sum_theta_diff;
    plane->theta_smooth = theta_smooth;
    return whole_duty(duty);
}

/* Returns whether both errors are below their thresholds. */
static int in_control(const BallbotPlane *plane)
{
    return (fabsf(plane->theta_diff) < theta_diff_thr) && (fabsf(plane->psi_diff) < psi_diff_thr);
}

/* Interprets a byte of a packet as a signed number. */
static S32 signed_byte(U8 byte)
{
    return (byte < 128U) ? (S32)byte : ((S32)byte - 256);
}

/* Speed commands of both planes (section 7.5, figure 7-1). */
static void command(S32 *stick_x, S32 *stick_y)
{
    *stick_x = 0;
    *stick_y = 0;
    if (autonomous == 0U) {
        S32 vertical = signed_byte(ballbot.bluetooth_rx[0]);

        if (ballbot.flag_avoid != 0U) {
            vertical = (S32)gp_max;
        }
        /* Stick up is negative and means forward; an int8 has no +128. */
        *stick_x = (vertical == -128) ? vertical : -vertical;
        *stick_y = signed_byte(ballbot.bluetooth_rx[1]);
    } else if (ballbot.flag_auto != 0U) {
        if (ballbot.flag_avoid != 0U) {
            *stick_y = (S32)gp_max;
        } else {
            *stick_x = (S32)gp_max;
        }
    } else {
        /* Stands still until time_auto. */
    }
}

/* Returns a pitch [deg] in units of lsb, rounded to nearest and limited to 16 bits. */
static S16 logged(float psi)
{
    const float counts = psi / lsb;
    const double rounded = floor((double)counts + 0.5);
    S16 value;

    if (rounded > 32767.0) {
        value = 32767;
    } else if (rounded < -32768.0) {
        value = -32768;
    } else {
        value = (S16)rounded;
    }
    return value;
}

/* Returns the reading of a gyro, limited to 16 bits with a sign. */
static S16 logged_gyro(U16 gyro)
{
    return (gyro > 32767U) ? (S16)32767 : (S16)gyro;
}

/* Sends a log packet every log_count ticks: the pitches, and what log_content adds. */
static void log_tick(S8 duty_x, S8 duty_y, U16 gyro_x, U16 gyro_y)
{
    if (ballbot.log_counter == 0U) {
        S8 data1 = 0;
        S8 data2 = 0;
        S16 adc3 = 0;
        S16 adc4 = 0;

        if (log_content >= LOG_DUTIES) {
            data1 = duty_x;
            data2 = duty_y;
        }
        if (log_content >= LOG_GYROS) {
            adc3 = logged_gyro(gyro_x);
            adc4 = logged_gyro(gyro_y);
        }
        ecrobot_bt_adc_data_logger(data1, data2, logged(ballbot.x.psi), logged(ballbot.y.psi),
                                   adc3, adc4);
    }
    ballbot.log_counter = (U8)((ballbot.log_counter + 1U) & 0xFFU);
    if (ballbot.log_counter == log_count) {
        ballbot.log_counter = 0U;
    }
}

/* Once, at each start: set all initial values (section 7.3). */
TASK(task_init)
{
    U32 n;

    reset(&ballbot.x);
    reset(&ballbot.y);
{% for variable in program_variables %}
{% if variable.length > 1 %}
    for (n = 0U; n < {{ variable.length }}U; n++) {
        ballbot.{{ variable.name }}[n] = {{ variable.initial }};
    }
{% else %}
    ballbot.{{ variable.name }} = {{ variable.initial }};
{% endif %}
{% endfor %}

    ballbot.battery = (float)ecrobot_get_battery_voltage();
    ballbot.x.gyro_offset = (float)ecrobot_get_gyro_sensor(GYRO_X);
    ballbot.y.gyro_offset = (float)ecrobot_get_gyro_sensor(GYRO_Y);
    ballbot.start_time = ecrobot_get_systick_ms();
    TerminateTask();
}

/* Every {{ periods.task_ts1 }} ms: calibrate, or balance, drive and log, or stop (section 7.4). */
TASK(task_ts1)
{
    S8 duty_x = 0;
    S8 duty_y = 0;
    U16 gyro_x = 0U;
    U16 gyro_y = 0U;

    if (ballbot.control_mode == BALLBOT_CONTROL) {
        const float max_voltage = (VOLTAGE_SLOPE * ballbot.battery) - VOLTAGE_OFFSET;
        S32 stick_x;
        S32 stick_y;

        /* Without a new packet the buffer keeps the last one. */
        (void)ecrobot_read_bt_packet(ballbot.bluetooth_rx, PACKET_SIZE);
        command(&stick_x, &stick_y);
        gyro_x = ecrobot_get_gyro_sensor(GYRO_X);
        duty_x = control(&ballbot.x, gyro_x, ecrobot_get_motor_rev(MOTOR_X), stick_x, max_voltage);
        gyro_y = ecrobot_get_gyro_sensor(GYRO_Y);
        duty_y = control(&ballbot.y, gyro_y, ecrobot_get_motor_rev(MOTOR_Y), stick_y, max_voltage);
    } else if (ballbot.control_mode == BALLBOT_CALIBRATION) {
        calibrate(&ballbot.x, ecrobot_get_gyro_sensor(GYRO_X));
        calibrate(&ballbot.y, ecrobot_get_gyro_sensor(GYRO_Y));
    } else {
        /* Stopped: the motors brake. */
    }
    ecrobot_set_motor_mode_speed(MOTOR_X, BRAKE, duty_x);
    ecrobot_set_motor_mode_speed(MOTOR_Y, BRAKE, duty_y);
    if (ballbot.control_mode == BALLBOT_CONTROL) {
        log_tick(duty_x, duty_y, gyro_x, gyro_y);
    }
    TerminateTask();
}

/* Every {{ periods.task_ts2 }} ms: look for an obstacle (section 7.5); hold the last echo if one is missed. */
TASK(task_ts2)
{
    const S32 sonar_cm = ecrobot_get_sonar_sensor(SONAR);
    const U32 now = ecrobot_get_systick_ms();

    if (sonar_cm != NO_ECHO_CM) {
        ballbot.distance_cm = sonar_cm;
        ballbot.echo_time = now;
    } else if ((now - ballbot.echo_time) > sonar_hold) {
        ballbot.distance_cm = NO_ECHO_CM;
    } else {
        /* The last echo still counts. */
    }
    ballbot.flag_avoid = (ballbot.distance_cm <= dst_thr) ? 1U : 0U;
    TerminateTask();
}

/* Every {{ periods.task_ts3 }} ms: operating state, battery voltage, sound (section 7.6). */
TASK(task_ts3)
{
    const float voltage = (float)ecrobot_get_battery_voltage();
    /* Unsigned differences survive the wrap of the system time. */
    const U32 elapsed = ecrobot_get_systick_ms() - ballbot.start_time;
    const U8 calibrated = (elapsed >= time_start) ? 1U : 0U;

    ballbot.battery = ((1.0f - a_b) * voltage) + (a_b * ballbot.battery);
    ballbot.flag_auto = (elapsed >= time_auto) ? 1U : 0U;
    if (in_control(&ballbot.x) && in_control(&ballbot.y)) {
        ballbot.timer_stop = elapsed;
    }
    if ((elapsed - ballbot.timer_stop) >= time_stop) {
        ballbot.control_mode = BALLBOT_STOP;
    } else if (calibrated != 0U) {
        ballbot.control_mode = BALLBOT_CONTROL;
    } else {
        ballbot.control_mode = BALLBOT_CALIBRATION;
    }

    if ((calibrated != 0U) && (ballbot.calibrated == 0U)) {
        (void)ecrobot_sound_tone(sound_frq, sound_dur, sound_volume);
    }
    ballbot.calibrated = calibrated;
    /* A tone in proportion to the distance, once the beep is over (section 10). */
    if ((tone_gain > 0U) && (calibrated != 0U) && ((elapsed - time_start) >= sound_dur)
        && (ballbot.distance_cm >= 0) && (ballbot.distance_cm < NO_ECHO_CM)) {
        U32 frequency = (U32)tone_gain * (U32)ballbot.distance_cm;

        if (frequency < LOWEST_TONE_HZ) {
            frequency = LOWEST_TONE_HZ;
        }
        (void)ecrobot_sound_tone(frequency, DISTANCE_TONE_MS, sound_volume);
    }
    TerminateTask();
}
