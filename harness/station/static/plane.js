// Metres about a place: the plane of the logs.
(function () {
  "use strict";
  const canine = (window.canine = window.canine || {});
  const SEMI_MAJOR_AXIS = 6378137.0, ECCENTRICITY_SQUARED = 6.69437999014e-3; // WGS 84

  // The plane that touches the earth at an origin [latitude, longitude] in deg.
  canine.plane = function ([latitude, longitude]) {
    const radians = Math.PI / 180, bend = 1 - ECCENTRICITY_SQUARED * Math.sin(latitude * radians) ** 2;
    const north = ((SEMI_MAJOR_AXIS * (1 - ECCENTRICITY_SQUARED)) / bend ** 1.5) * radians;
    const east = (SEMI_MAJOR_AXIS / Math.sqrt(bend)) * Math.cos(latitude * radians) * radians;
    return {
      toDegrees: ([n, e]) => [latitude + n / north, longitude + e / east],
      toMetres: ([lat, lon]) => [(lat - latitude) * north, (lon - longitude - 360 * Math.round((lon - longitude) / 360)) * east],
    };
  };
})();
