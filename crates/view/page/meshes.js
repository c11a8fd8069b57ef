// Loads the user's own meshes. The loaders of three.js need the page's document, so the page loads them. The
// artist gets plain arrays. Without a mesh folder nothing is loaded.

// Largest number of triangles per file. The robot is drawn 60 times a second.
const TRIANGLES_MAX = 400_000;
// Colour that ColladaLoader gives to a mesh without a material.
const UNPAINTED = 0xff00ff;

const LOADERS = {
  async dae() {
    const { ColladaLoader } = await import("./three/loaders/ColladaLoader.js");
    // A URDF uses a mesh's axes as stored in the file, whatever up-axis the file names.
    return async (url, manager) => { const { scene } = await new ColladaLoader(manager).loadAsync(url); scene.rotation.set(0, 0, 0); return scene; };
  },
  async stl() {
    const [{ STLLoader }, { Mesh, MeshBasicMaterial }] = [await import("./three/loaders/STLLoader.js"), await import("./three.module.min.js")];
    return async (url, manager) => {
      const geometry = await new STLLoader(manager).loadAsync(url);
      return new Mesh(geometry, new MeshBasicMaterial({ vertexColors: geometry.hasColors === true }));
    };
  },
  async glb() {
    const { GLTFLoader } = await import("./three/loaders/GLTFLoader.js");
    return async (url, manager) => (await new GLTFLoader(manager).loadAsync(url)).scene;
  },
  async obj() {
    const [{ OBJLoader }, { MTLLoader }] = [await import("./three/loaders/OBJLoader.js"), await import("./three/loaders/MTLLoader.js")];
    return async (url, manager) => {
      const loader = new OBJLoader(manager);
      // The materials are beside the mesh under the same name. Otherwise it has none.
      const materials = await new MTLLoader(manager).loadAsync(url.replace(/obj$/i, "mtl")).catch(() => null);
      if (materials) loader.setMaterials(materials);
      return loader.loadAsync(url);
    };
  },
};
LOADERS.gltf = LOADERS.glb;

export class MeshLoader {
  // `token` is the token of the page's address.
  constructor(token) {
    this.base = `./meshes/${token}/`;
    this.loaders = {};
  }

  // Returns a scene's meshes with their arrays, and the names of those that cannot be read. Calls `progress` for
  // each file.
  async load(meshes, progress) {
    const files = new Map(meshes.map((mesh) => [mesh.file, null])), failed = [];
    let done = 0;
    for (const file of files.keys()) {
      progress(done, files.size);
      done += 1;
      try {
        files.set(file, await this.read(file));
      } catch (error) {
        failed.push(`${file}: ${error.message ?? error}`);
      }
    }
    const drawn = meshes.flatMap((mesh) => (files.get(mesh.file) ?? []).map((arrays) => ({
      ...mesh, positions: arrays.positions.slice(), normals: arrays.normals.slice(), colours: arrays.colours?.slice() ?? null,
    })));
    return { drawn, failed };
  }

  async read(file) {
    const kind = file.split(".").at(-1).toLowerCase();
    this.loaders[kind] ??= await LOADERS[kind]();
    const { LoadingManager } = await import("./three.module.min.js");
    const manager = new LoadingManager();
    const object = await this.loaders[kind](this.base + file.split("/").map(encodeURIComponent).join("/"), manager);
    await images(object);
    return flat(object);
  }
}

// Waits for the textures of an object. Some loaders return before these are loaded.
async function images(object) {
  const waiting = [];
  object.traverse(({ material }) => {
    for (const { map } of [material ?? []].flat()) if (map && !map.image?.complete && !map.image?.close) waiting.push(map);
  });
  const giveUp = performance.now() + 5000;
  while (waiting.some((map) => !map.image || map.image.complete === false) && performance.now() < giveUp) {
    await new Promise((resolve) => { setTimeout(resolve, 50); });
  }
}

// Returns the triangles of an object as arrays, one per material: positions, normals, and colours if it has its
// own.
function flat(object) {
  object.updateMatrixWorld(true);
  const all = [];
  let triangles = 0;
  object.traverse((mesh) => {
    if (!mesh.isMesh) return;
    const own = mesh.geometry.clone().applyMatrix4(mesh.matrixWorld);
    if (!own.attributes.normal) own.computeVertexNormals();
    const geometry = own.index ? own.toNonIndexed() : own;
    const count = geometry.attributes.position.count;
    triangles += count / 3;
    if (triangles > TRIANGLES_MAX) throw new Error(`more than ${TRIANGLES_MAX} triangles`);
    const groups = geometry.groups.length > 0 ? geometry.groups : [{ start: 0, count, materialIndex: 0 }];
    for (const { start, count: length, materialIndex } of groups) {
      const material = [mesh.material].flat()[materialIndex ?? 0], part = (name) => geometry.attributes[name].array.slice(3 * start, 3 * (start + length));
      all.push({ positions: Float32Array.from(part("position")), normals: Float32Array.from(part("normal")), colours: painted(geometry, material, start, length) });
    }
  });
  if (all.length === 0) throw new Error("there is no mesh in it");
  return all;
}

// Returns a colour for each vertex, or nothing if the file has no colours. Textures are sampled at the vertices.
function painted(geometry, material, start, count) {
  const colour = material?.color, vertex = material?.vertexColors ? geometry.attributes.color : null;
  const isPlain = !colour || colour.getHex() === UNPAINTED || (colour.getHex() === 0xffffff && !material.name);
  const texture = material?.map?.image ? pixels(material.map) : null;
  if (!vertex && !texture && isPlain) return null;
  const colours = new Float32Array(3 * count), base = isPlain ? [1, 1, 1] : colour.toArray(), uv = geometry.attributes.uv;
  for (let n = 0; n < count; n += 1) {
    const tint = vertex ? [vertex.getX(start + n), vertex.getY(start + n), vertex.getZ(start + n)] : [1, 1, 1];
    const sample = texture && uv ? texture(uv.getX(start + n), uv.getY(start + n)) : [1, 1, 1];
    colours.set(base.map((channel, k) => channel * tint[k] * sample[k]), 3 * n);
  }
  return colours;
}

// Samples a texture at u and v, as linear colours.
function pixels(map) {
  const { image } = map, canvas = new OffscreenCanvas(image.width, image.height), pen = canvas.getContext("2d");
  pen.drawImage(image, 0, 0);
  const { data, width, height } = pen.getImageData(0, 0, image.width, image.height);
  const wrap = (x, size) => Math.min(size - 1, Math.floor((x - Math.floor(x)) * size));
  return (u, v) => {
    const at = 4 * (wrap(map.flipY ? 1 - v : v, height) * width + wrap(u, width));
    return [0, 1, 2].map((k) => (data[at + k] / 255) ** 2.2);
  };
}
