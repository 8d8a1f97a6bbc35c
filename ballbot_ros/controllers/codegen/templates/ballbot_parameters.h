/*
 * Parameters of the ballbot's control program; their meanings are in DATA_DICTIONARY.md.
 *
 * {{ stamp }}
 */
#ifndef BALLBOT_PARAMETERS_H
#define BALLBOT_PARAMETERS_H

#include "ecrobot_interface.h"

{% for parameter in parameters %}
extern const {{ parameter.c_type }} {{ parameter.declarator }};
{% endfor %}

#endif
