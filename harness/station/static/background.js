// What lies under the map: a picture with its world file, or a .pmtiles file of pictures or of Protomaps' basemap. All stay in
// the browser.
(function () {
  "use strict";
  const canine = (window.canine = window.canine || {});
  const MOST_BYTES = 60e6; // of a picture
  const WORLD_BYTES = 1000; // of a world file, which has some 100
  const PICTURE = /\.(png|jpe?g|webp|gif)$/i, WORLD = /\.(pgw|jgw|wld|tfw|gfw|pngw|jpgw)$/i, TILES = /\.pmtiles$/i;
  const RASTER = { 2: "PNG", 3: "JPEG", 4: "WebP", 5: "AVIF" }; // PMTiles' types of tiles that are pictures
  const VECTOR = 1;
  const LAYERS = ["earth", "landcover", "landuse", "water", "physical_line", "roads", "transit", "buildings", "boundaries", "places", "pois"];

  // A world file: six numbers, line by line: the pixel's size in x, two rotations, its size in y, the first pixel's centre.
  canine.readWorld = function (text) {
    const numbers = text.trim().split(/\s+/).map(Number);
    if (numbers.length !== 6 || !numbers.every(Number.isFinite)) {
      throw new Error(`the world file has ${numbers.length} values, expected 6 numbers, one on a line`);
    }
    const [width, skew, shear, height, x, y] = numbers;
    if (skew !== 0 || shear !== 0) throw new Error(`the picture is rotated (${skew}, ${shear}), expected north up: both 0`);
    if (!(width > 0) || !(height < 0)) throw new Error(`a pixel is ${width} by ${height}, expected above 0 and below 0: north up`);
    return { width, height, x, y };
  };
  // The corners of a picture of so many pixels, [[south, west], [north, east]] in deg.
  canine.corners = function ({ width, height, x, y }, [columns, rows], crs, home) {
    const west = x - width / 2, north = y - height / 2, east = west + columns * width, south = north + rows * height;
    if (crs === "metres" && !home) throw new Error("home is not marked, and the world file counts metres from it");
    const place = {
      metres: ([e, n]) => canine.plane(home).toDegrees([n, e]),
      mercator: ([e, n]) => { const { lat, lng } = L.CRS.EPSG3857.unproject(L.point(e, n)); return [lat, lng]; },
      degrees: ([e, n]) => [n, e],
    }[crs];
    const corners = [place([west, south]), place([east, north])];
    const far = corners.find(([latitude, longitude]) => !(Math.abs(latitude) <= 90 && Math.abs(longitude) <= 180));
    if (far) {
      throw new Error(`a corner of the picture is ${far.map((value) => value.toFixed(1)).join(", ")}, expected latitude -90 to 90 and longitude -180 to 180 deg; ` +
        "is the choice of metres, Mercator or degrees right?");
    }
    return corners;
  };

  canine.background = function (leaflet, { files, crs, opacity, remove, said }, homeOf) {
    let layer = null, address = null, repaint = null;
    leaflet.createPane("ground").style.zIndex = 120;
    const clear = function () {
      if (layer) layer.remove();
      if (address) URL.revokeObjectURL(address);
      layer = address = repaint = null;
    };
    canine.onRestyle(() => repaint && repaint());
    const setOpacity = () => layer && layer.setOpacity(Number(opacity.value));

    async function picture(image, world) {
      if (!world) throw new Error(`${image.name} has no world file; choose both together, such as map.png and map.pgw`);
      if (image.size > MOST_BYTES) throw new Error(`${image.name} has ${image.size} bytes, expected ${MOST_BYTES} at most`);
      if (world.size > WORLD_BYTES) throw new Error(`${world.name} has ${world.size} bytes, expected ${WORLD_BYTES} at most`);
      const corners = canine.readWorld(await world.text()), drawn = await createImageBitmap(image);
      const bounds = canine.corners(corners, [drawn.width, drawn.height], crs.value, homeOf());
      drawn.close();
      clear();
      address = URL.createObjectURL(image);
      layer = L.imageOverlay(address, bounds, { pane: "ground", alt: "" }).addTo(leaflet);
      leaflet.fitBounds(bounds);
      return `${image.name} lies under the map`;
    }
    async function tiles(file) {
      const archive = new pmtiles.PMTiles(new pmtiles.FileSource(file)), header = await archive.getHeader();
      const { minLat, minLon, maxLat, maxLon, minZoom, maxZoom, tileType } = header;
      const said = `${file.name} lies under the map: ${RASTER[tileType] || "vectors"}, zoom ${minZoom} to ${maxZoom}`;
      const bounds = [[minLat, minLon], [maxLat, maxLon]], common = { pane: "ground", minZoom, maxZoom: 23, bounds };
      if (tileType === VECTOR) {
        const known = await basemap(archive, file.name);
        clear();
        repaint = function () {
          if (layer) layer.remove();
          layer = protomapsL.leafletLayer({ ...common, url: archive, maxDataZoom: maxZoom, flavor: canine.isDark() ? "dark" : "light", lang: "en" });
          layer.addTo(leaflet);
          setOpacity();
        };
        repaint();
        leaflet.fitBounds(bounds);
        return said + known;
      }
      if (!RASTER[tileType]) throw new Error(`${file.name} holds tiles of type ${tileType}, expected ${Object.values(RASTER).join(", ")} or vectors`);
      clear();
      layer = pmtiles.leafletRasterLayer(archive, { ...common, minNativeZoom: minZoom, maxNativeZoom: maxZoom }).addTo(leaflet);
      leaflet.fitBounds(bounds);
      return said;
    }
    // Whose map it is, in words; an error if it has none of the layers that are drawn.
    async function basemap(archive, name) {
      const { vector_layers: stated, attribution } = await archive.getMetadata(), layers = (stated || []).map(({ id }) => id);
      if (layers.length && !layers.some((id) => LAYERS.includes(id))) {
        throw new Error(`${name} has the layers ${layers.join(", ")}, expected some of Protomaps' basemap: ${LAYERS.join(", ")}`);
      }
      const source = new DOMParser().parseFromString(String(attribution || ""), "text/html").body.textContent.trim();
      return source ? `; ${source}` : "";
    }
    async function choose() {
      const some = [...files.files], find = (kind) => some.find(({ name }) => kind.test(name));
      try {
        const archive = find(TILES), image = find(PICTURE);
        if (!archive && !image) throw new Error("no picture and no .pmtiles among the files");
        said.textContent = archive ? await tiles(archive) : await picture(image, find(WORLD));
        setOpacity();
      } catch (error) {
        said.textContent = "Not drawn: " + error.message;
      }
      files.value = "";
    }
    files.addEventListener("change", choose);
    opacity.addEventListener("input", setOpacity);
    remove.addEventListener("click", () => {
      clear();
      said.textContent = "";
    });
  };
})();
