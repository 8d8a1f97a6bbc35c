/*
 * Parameters of the ballbot's control program.
 *
 * {{ stamp }}
 *
 * Floats have the fewest digits that give exactly the single-precision value of the simulation.
 */
#include "ballbot_parameters.h"

{% for parameter in parameters %}
const {{ parameter.c_type }} {{ parameter.declarator }} = {{ parameter.initial }}; /* {{ parameter.comment }} */
{% endfor %}
