<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>
<!-- Colour: change of height, brown where the ground rose, blue-green where it sank. -->
<qgis version="3.34.0" styleCategories="Symbology">
 <pipe>
  <provider>
   <resampling enabled="false" zoomedInResamplingMethod="nearestNeighbour" zoomedOutResamplingMethod="nearestNeighbour" maxOversampling="2"/>
  </provider>
  <rasterrenderer type="singlebandpseudocolor" band="1" alphaBand="-1" opacity="1" classificationMin="-0.1" classificationMax="0.1" nodataColor="">
   <rastershader>
    <colorrampshader colorRampType="INTERPOLATED" classificationMode="1" clip="0" minimumValue="-0.1" maximumValue="0.1" labelPrecision="2">
     <item value="-0.1" label="-0.10 m" color="#01665e" alpha="255"/>
     <item value="-0.05" label="-0.05 m" color="#80cdc1" alpha="255"/>
     <item value="0" label="0.00 m" color="#f5f5f5" alpha="0"/>
     <item value="0.05" label="0.05 m" color="#dfc27d" alpha="255"/>
     <item value="0.1" label="0.10 m" color="#8c510a" alpha="255"/>
    </colorrampshader>
   </rastershader>
  </rasterrenderer>
  <brightnesscontrast brightness="0" contrast="0" gamma="1"/>
  <huesaturation colorizeOn="0" saturation="0" grayscaleMode="0" invertColors="0"/>
  <rasterresampler maxOversampling="2"/>
  <resamplingStage>resamplingFilter</resamplingStage>
 </pipe>
 <blendMode>0</blendMode>
</qgis>
